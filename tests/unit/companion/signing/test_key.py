"""A key that is none, or that others may read, is refused by name."""

from __future__ import annotations

import secrets
from pathlib import Path

import pytest

from companion.errors import ConfigError
from companion.signing.key import read_signing_key

KEY = secrets.token_bytes(32)


def test_the_key_is_32_bytes_or_their_digits_and_for_its_owner_alone(tmp_path: Path) -> None:
    path = tmp_path / "mavlink.key"
    path.write_bytes(KEY)
    path.chmod(0o644)
    with pytest.raises(ConfigError, match="chmod 600"):
        read_signing_key(path)
    path.chmod(0o600)
    assert read_signing_key(path) == KEY
    path.write_text(KEY.hex() + "\n")
    assert read_signing_key(path) == KEY
    path.write_text(KEY.hex() + "  -\n")  # as sha256sum writes it
    assert read_signing_key(path) == KEY
    path.write_bytes(KEY[:31])
    with pytest.raises(ConfigError, match="31 bytes of signing key; expected 32, or 64 hexadecimal digits"):
        read_signing_key(path)
    with pytest.raises(ConfigError, match="cannot read the signing key: No such file"):
        read_signing_key(tmp_path / "missing")
