"""What outlives a restart: exactly where the windows were after an end in order, later after a crash, never earlier."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path

import pytest

from companion.errors import ConfigError
from companion.signing import book
from companion.signing.book import FILE, GUARD_S, SigningBook
from companion.signing.frames import UNITS_PER_S

WINDOWS = {(0, 1, 1): 700_000, (3, 1, 191): 900_000}


def test_an_end_in_order_goes_on_where_it_was(tmp_path: Path) -> None:
    first = SigningBook(tmp_path / "state")
    assert (first.sent, first.windows) == (0, {})
    first.start(lambda: (800_000, WINDOWS))
    first.close()
    again = SigningBook(tmp_path / "state")
    assert (again.sent, again.windows) == (800_000, WINDOWS)
    with pytest.raises(ConfigError, match="in use by another companion service"):
        SigningBook(tmp_path / "state")
    again.close()


def test_after_a_crash_the_windows_begin_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(book, "PERIOD_S", 0.02)
    first = SigningBook(tmp_path)
    first.start(lambda: (800_000, WINDOWS))
    while b"800000" not in (tmp_path / FILE).read_bytes():
        time.sleep(0.01)
    first._sole.close()  # as the kernel does with the process
    again = SigningBook(tmp_path)
    guard = round(GUARD_S * UNITS_PER_S)
    assert again.sent == 800_000 + guard
    assert again.windows == {window: t + guard for window, t in WINDOWS.items()}
    first._stop.set()
    again.close()


@pytest.mark.parametrize("text", ["", "[]", '{"sent": "x"}', '{"windows": {"1/2": 3}}', '{"windows": {"a/b/c": 3}}'])
def test_a_damaged_file_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE).write_text(text)
    with pytest.raises(ConfigError, match=r"mavlink-signing\.json is damaged"):
        SigningBook(tmp_path)


def test_a_place_that_cannot_be_written_is_named_and_a_disk_that_fails_later_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match=r"state_dir: .* cannot be"):
        SigningBook(tmp_path / "file" / "state")
    kept = SigningBook(tmp_path / "state")
    assert json.loads((tmp_path / "state" / FILE).read_bytes())["in_order"] is False
    shutil.rmtree(tmp_path / "state")
    kept.close()
    assert kept.failed
