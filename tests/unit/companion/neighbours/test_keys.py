"""Secret keys: made, kept private, never replaced."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

import pytest

from companion.cli import main
from companion.errors import ConfigError
from companion.neighbours.keys import read_key, write_key


def test_keys_are_private_and_never_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["companion", "keygen", str(tmp_path / "a.key"), str(tmp_path / "b.key")])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    first = read_key(tmp_path / "a.key")
    assert len(first) == 32
    assert first != read_key(tmp_path / "b.key")
    assert stat.S_IMODE((tmp_path / "a.key").stat().st_mode) == 0o600
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    assert read_key(tmp_path / "a.key") == first
    (tmp_path / "a.key").chmod(0o640)
    with pytest.raises(ConfigError, match="chmod 600"):
        read_key(tmp_path / "a.key")
    write_key(tmp_path / "c.key")
    (tmp_path / "c.key").write_bytes(b"short")
    with pytest.raises(ConfigError, match="at least 32"):
        read_key(tmp_path / "c.key")


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give files away")
def test_a_key_can_be_made_for_the_services_user(tmp_path: Path) -> None:
    write_key(tmp_path / "a.key", "nobody")
    assert (tmp_path / "a.key").owner() == "nobody"
    assert stat.S_IMODE((tmp_path / "a.key").stat().st_mode) == 0o600


def test_a_key_for_nobody_known_is_not_made(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no-such-user: there is no such user"):
        write_key(tmp_path / "a.key", "no-such-user")
    assert not (tmp_path / "a.key").exists()
