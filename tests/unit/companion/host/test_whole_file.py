"""A file is there as a whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.host.whole_file import whole_file, write_whole


def test_what_fails_half_way_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    write_whole(path, "first")

    def fail() -> None:
        with whole_file(path) as file:
            file.write(b"half")
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        fail()
    assert path.read_text() == "first"
    assert list(tmp_path.iterdir()) == [path]


def test_a_new_file_has_the_mode_that_others_have_and_a_link_stays_one(tmp_path: Path) -> None:
    plain, path, link = (tmp_path / name for name in ("plain", "whole", "link"))
    plain.write_text("")
    write_whole(path, "x")
    assert path.stat().st_mode == plain.stat().st_mode
    link.symlink_to(path)
    write_whole(link, "y")
    assert link.is_symlink()
    assert path.read_text() == "y"


def test_a_device_is_written_to_directly() -> None:
    write_whole(Path("/dev/null"), "x")
    with pytest.raises(OSError, match="No space"):
        write_whole(Path("/dev/full"), "x")
