"""The secret key of MAVLink message signing: a file that only its owner may read."""

from __future__ import annotations

import re
import stat
from pathlib import Path
from typing import Final

from companion.errors import ConfigError
from csi_bridge.regular_file import open_regular

KEY_BYTES: Final = 32
_HEX: Final = re.compile(rb"([0-9a-fA-F]{64})(\s+-)?\s*")
"""Also with the dash that `sha256sum` writes behind its digits."""


def read_signing_key(path: Path) -> bytes:
    """32 bytes, or 64 hexadecimal digits. Raises ConfigError for a file that is missing, of another length, or readable
    by others."""
    try:
        mode = path.stat().st_mode
        with open_regular(path) as file:
            data = file.read(4096)
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the signing key: {error.strerror}") from None
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigError(f"{path}: the signing key must be readable by its owner only: chmod 600 {path}")
    if digits := _HEX.fullmatch(data):
        return bytes.fromhex(digits[1].decode())
    if len(data) != KEY_BYTES:
        raise ConfigError(f"{path}: {len(data)} bytes of signing key; expected 32, or 64 hexadecimal digits")
    if not any(data):
        raise ConfigError(f"{path}: 32 zeros and no signing key, as a power cut leaves files; copy it again")
    return data
