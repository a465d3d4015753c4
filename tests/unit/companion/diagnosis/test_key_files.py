"""Key files that a configuration names: each fault that the service refuses, told by `companion config check`."""

from __future__ import annotations

import os
import secrets
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from companion.cli import program
from companion.config.file import load_config, save_config
from companion.config.schema import Config, PageConfig
from companion.diagnosis.key_files import look_at_key_files
from companion.errors import ConfigError
from tests.paths import CONFIGS


def _key(path: Path, data: bytes, mode: int = 0o600) -> None:
    path.write_bytes(data)
    path.chmod(mode)


@pytest.fixture
def config(tmp_path: Path) -> Config:
    for name in ("own", "peer", "next"):
        _key(tmp_path / name, secrets.token_bytes(32))
    shipped = load_config(CONFIGS / "uav.yaml")
    peer = replace(shipped.peers[0], key_file=str(tmp_path / "peer"), next_key_file=str(tmp_path / "next"))
    neighbours = replace(shipped.neighbours, key_file=str(tmp_path / "own"))
    return replace(shipped, neighbours=neighbours, peers=[peer])


def test_right_keys_are_said_nothing_of(config: Config, tmp_path: Path) -> None:
    found = look_at_key_files(config)
    assert (found.errors, found.notes) == ([], [])
    (tmp_path / "next").write_bytes((tmp_path / "peer").read_bytes())
    assert look_at_key_files(config).errors == [], "one robot may have one key under two names"


@pytest.mark.parametrize(
    ("data", "mode", "told"),
    [
        (b"short", 0o600, "5 bytes of key, expected at least 32"),
        (b"", 0o600, "0 bytes of key"),
        (bytes(32), 0o600, "zeros or blanks and no key"),
        (b" \r\n" * 20, 0o600, "zeros or blanks and no key"),
        (bytes(range(32)), 0o640, "chmod 600"),
        (bytes(range(32)), 0o604, "chmod 600"),
    ],
    ids=["short", "empty", "zeros", "blanks", "read by the group", "read by all"],
)
def test_each_fault_of_a_file_names_its_key_and_the_file(
    config: Config, tmp_path: Path, data: bytes, mode: int, told: str
) -> None:
    _key(tmp_path / "peer", data, mode)
    (error,) = look_at_key_files(config).errors
    assert error.startswith(f"peers[0].key_file: {tmp_path}/peer: ") and told in error


def test_a_file_that_is_missing_a_folder_or_another_robots_key(config: Config, tmp_path: Path) -> None:
    (tmp_path / "peer").unlink()
    (tmp_path / "next").unlink()
    (tmp_path / "next").mkdir()
    missing, folder = look_at_key_files(config).errors
    assert missing.startswith("peers[0].key_file: ") and "No such file" in missing and "keygen" in missing
    assert folder.startswith("peers[0].next_key_file: ") and "Is a directory" in folder
    (tmp_path / "next").rmdir()
    for name in ("peer", "next"):
        _key(tmp_path / name, (tmp_path / "own").read_bytes())
    for error in look_at_key_files(config).errors:
        assert "holds the same key as neighbours.key_file" in error


def test_what_is_on_another_machine_or_closed_to_the_user_is_a_note(config: Config, tmp_path: Path) -> None:
    elsewhere = replace(config, neighbours=replace(config.neighbours, key_file="/no/such/folder/own.key"))
    found = look_at_key_files(elsewhere)
    assert found.errors == []
    assert found.notes == ["neighbours.key_file: there is no folder /no/such/folder here; not looked at"]
    if os.getuid() != 0:
        (tmp_path / "own").chmod(0)
        assert "may not be read by this user; not looked at" in look_at_key_files(config).notes[0]


def test_signing_keys_and_words_of_pages_are_looked_at_too(config: Config, tmp_path: Path) -> None:
    assert config.autopilot is not None
    _key(tmp_path / "word", b"short")
    _key(tmp_path / "signing", bytes(32))
    page = PageConfig(enabled=True, token_file=str(tmp_path / "word"))
    autopilot = replace(config.autopilot, signing_key_file=str(tmp_path / "signing"))
    signing, word = look_at_key_files(replace(config, autopilot=autopilot, page=page)).errors
    assert signing.startswith("autopilot.signing_key_file: ") and "32 zeros" in signing
    assert word.startswith("page.token_file: ") and "16 letters" in word
    off = replace(config, page=replace(page, enabled=False))
    assert look_at_key_files(off).errors == []


def test_the_command_ends_with_every_error_and_says_what_it_did_not_see(config: Config, tmp_path: Path) -> None:
    text = secrets.token_hex(32).encode() + b"\n"
    _key(tmp_path / "own", text)
    save_config(config, tmp_path / "uav.yaml")
    done = CliRunner().invoke(program, ["config", "check", str(tmp_path / "uav.yaml")])
    assert done.exit_code == 0 and "OK, role uav" in done.output
    assert "the line end behind the text is part of the key" in done.output
    _key(tmp_path / "own", b"x", 0o600)
    _key(tmp_path / "peer", b"y", 0o600)
    refused = CliRunner().invoke(program, ["config", "check", str(tmp_path / "uav.yaml")])
    assert isinstance(refused.exception, ConfigError) and refused.exception.exit_code == 2
    assert str(refused.exception).startswith(f"{tmp_path}/uav.yaml: 2 errors\n  neighbours.key_file: ")
