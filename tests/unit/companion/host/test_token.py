"""The word of a page: read from a file that only its owner may read."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.errors import ConfigError
from companion.host.token import is_token, read_token

WORD = "q7Zk1mVh0pXw3uTs"


def _file(folder: Path, text: str, mode: int = 0o600) -> Path:
    path = folder / "token"
    path.write_text(text)
    path.chmod(mode)
    return path


def test_a_word_is_read_without_its_line_end(tmp_path: Path) -> None:
    assert read_token(_file(tmp_path, f"{WORD}\n")) == WORD


@pytest.mark.parametrize("text", ["short", "", f"{WORD} {WORD}", f"{WORD}\0", "ü" * 20, f"{WORD}+/="])
def test_what_is_no_word_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError, match="16 letters"):
        read_token(_file(tmp_path, text))


def test_a_word_that_others_may_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="chmod 600"):
        read_token(_file(tmp_path, WORD, 0o640))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot read the token"):
        read_token(tmp_path / "none")


def test_only_the_word_itself_is_the_word() -> None:
    assert is_token(WORD, WORD)
    assert not any(is_token(given, WORD) for given in ("", WORD[:-1], WORD + "x", "ü" * 16))
