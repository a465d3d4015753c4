"""The files of one recording: which of them may go."""

from __future__ import annotations

import errno
import io
import os
from pathlib import Path

import pytest

from companion.core.streams import CSI
from companion.errors import CompanionError
from companion.log.parts import open_part, parts_beside, remove_oldest
from csi_bridge.regular_file import open_regular


def test_the_budget_takes_the_oldest_finished_files_and_no_others(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    begun = [open_part(path, {}, "zstd", 65536) for _ in range(4)]
    stranger = tmp_path / "other.mcap"
    stranger.write_bytes(bytes(100_000))
    for part in (begun[0], begun[2], begun[3]):
        part.write(CSI, 1, 1, 1, message=os.urandom(10_000), taken_s=0.0)
        part.finish()
    # The first may go, the second is still being written, the third may go, the last is the newest finished one.
    newest = parts_beside(path)[-1].stat().st_size
    last = open_part(path, {}, "zstd", 65536)
    assert remove_oldest(path, newest + 1_000) == 2
    assert [p.name for p in parts_beside(path)] == ["log.1.mcap", "log.3.mcap", "log.4.mcap"]
    assert stranger.exists()
    begun[1].finish()
    last.finish()
    assert [p.name for p in parts_beside(path)] == ["log.1.mcap", "log.3.mcap", "log.4.mcap"]


def test_what_is_another_users_stays_and_keeps_nobody_from_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.mcap"
    for _ in range(4):
        open_part(path, {}, "zstd", 65536).finish()
    unlink, read = Path.unlink, open_regular

    def unlinked(one: Path, missing_ok: bool = False) -> None:
        if one.name == "log.1.mcap":
            raise PermissionError(errno.EPERM, "Operation not permitted")
        unlink(one, missing_ok=missing_ok)

    def opened(one: Path) -> io.BufferedReader:
        if one.name == "log.mcap":
            raise PermissionError(errno.EACCES, "Permission denied")
        return read(one)

    monkeypatch.setattr(Path, "unlink", unlinked)
    monkeypatch.setattr("companion.log.parts.open_regular", opened)
    assert remove_oldest(path, 0) == 2
    assert [p.name for p in parts_beside(path)] == ["log.mcap", "log.1.mcap"]


def test_a_part_that_cannot_be_begun_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a full disk one is tried every few seconds: each would leave an empty one."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("companion.log.parts.LogWriter", full)
    with pytest.raises(CompanionError, match="No space left on device"):
        open_part(tmp_path / "log.mcap", {}, "zstd", 65536)
    assert list(tmp_path.iterdir()) == []
