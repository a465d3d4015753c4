"""The secret word of a page: a file that only its owner may read."""

from __future__ import annotations

import hmac
import re
import stat
from pathlib import Path
from typing import Final

from companion.errors import ConfigError
from csi_bridge.regular_file import open_regular

_LARGEST_BYTES: Final = 4096
_TOKEN: Final = re.compile(r"[A-Za-z0-9_.~-]{16,512}")


def read_token(path: Path) -> str:
    """Raises ConfigError when it is missing, short, of other characters than a URL may hold, or readable by others."""
    try:
        mode = path.stat().st_mode
        with open_regular(path) as file:
            data = file.read(_LARGEST_BYTES)
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the token: {error.strerror} (docs/page.md makes one)") from None
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigError(f"{path}: the token must be readable by its owner only: chmod 600 {path}")
    token = data.decode("ascii", "replace").strip()
    if not _TOKEN.fullmatch(token):
        raise ConfigError(f"{path}: expected one word of 16 letters or digits or more, - and _ among them")
    return token


def is_token(given: str, token: str) -> bool:
    """In a time that says nothing of how much of it is right."""
    return hmac.compare_digest(given.encode("utf-8", "replace"), token.encode())
