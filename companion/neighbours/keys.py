"""Secret keys of robots: files of random bytes that only their owner may read.

A key is replaced without a gap: every robot takes the new one as `next_key_file` of the peer, then the peer itself
changes over, then `next_key_file` becomes `key_file`. Meanwhile both are valid.
"""

from __future__ import annotations

import os
import pwd
import secrets
import stat
from pathlib import Path

from companion.errors import CompanionError, ConfigError
from companion.neighbours import wire
from csi_bridge.regular_file import open_regular

_LARGEST_BYTES = 1 << 16


def read_key(path: Path) -> bytes:
    """The secret bytes in `path`. Raises ConfigError when it is missing, short, or readable by others."""
    try:
        mode = path.stat().st_mode
        with open_regular(path) as file:
            key = file.read(_LARGEST_BYTES)  # whatever the name stands for
    except OSError as error:
        raise ConfigError(
            f"{path}: cannot read the key: {error.strerror} (companion keygen makes one, on the robot whose key it is)"
        ) from None
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigError(f"{path}: the key must be readable by its owner only: chmod 600 {path}")
    if len(key) < wire.MIN_KEY_BYTES:
        raise ConfigError(f"{path}: {len(key)} bytes of key, expected at least {wire.MIN_KEY_BYTES}")
    if not key.strip(b"\0 \t\r\n"):
        raise ConfigError(f"{path}: zeros or blanks and no key, as a power cut leaves files; copy it again")
    return key


def write_key(path: Path, owner: str | None = None) -> None:
    """A new random key with mode 0600 from its first moment, of the user `owner` where that is given. Raises
    CompanionError; an existing file is never replaced."""
    uid = -1 if owner is None else _uid(owner)
    made = False
    try:
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            made = True
            file.write(secrets.token_bytes(wire.MIN_KEY_BYTES))
            os.fchmod(file.fileno(), 0o600)  # whatever the umask took away
            os.fchown(file.fileno(), uid, -1)
    except OSError as error:
        if made:  # a key that is cut short would be taken for one
            path.unlink(missing_ok=True)
        raise CompanionError(f"{path}: cannot write the key: {error.strerror}") from None


def _uid(owner: str) -> int:
    try:
        return pwd.getpwnam(owner).pw_uid
    except KeyError:
        raise ConfigError(f"{owner}: there is no such user") from None
