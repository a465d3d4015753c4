"""Where results go: what is there already is replaced by its like alone."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from companion.cli import program
from companion.commands.output_files import JSON, PAGE, PICTURE, TEXT, check_writable, write_json
from companion.errors import CompanionError

_HELD = {
    "log.mcap": b"\x89MCAP0\r\n" + bytes(20),
    "csi.dat": b"\x00\xd5\xbb\x01",
    "walk.csv": b"1614835106,5,1.0,2.0,3.0\n",
    "walk.tum": b"\n# t x y z\n1.0 2.0\n",
    "uav.yaml": b"role: uav\n",
    "groundtruth_positions.json": b"{}",
}


@pytest.mark.parametrize("name", _HELD)
@pytest.mark.parametrize("kind", [JSON, PAGE])
def test_a_result_takes_the_place_of_no_recording(tmp_path: Path, name: str, kind: str) -> None:
    path = tmp_path / name
    path.write_bytes(_HELD[name])
    with pytest.raises(CompanionError, match=rf"{name}: is there already, and no {kind} of ours; choose another name"):
        check_writable(path, kind=kind)
    if kind == JSON:
        with pytest.raises(CompanionError, match="is there already"):
            write_json(path, {"a": 1})
    assert path.read_bytes() == _HELD[name]


@pytest.mark.parametrize(
    ("kind", "content"),
    [
        (JSON, b"[]"), (JSON, b"\xef\xbb\xbf {}"), (PAGE, b"<!doctype html>"), (PICTURE, b"\x89PNG\r\n"),
        (TEXT, b"| a |\n"), (TEXT, b""),
    ],
)  # fmt: skip
def test_a_result_takes_the_place_of_the_one_before(tmp_path: Path, kind: str, content: bytes) -> None:
    (tmp_path / "result").write_bytes(content)
    check_writable(tmp_path / "result", kind=kind)
    check_writable(tmp_path / "new", kind=kind)
    assert not (tmp_path / "new").exists()
    check_writable(Path("/dev/null"), kind=kind)


def test_a_dash_makes_no_file_of_that_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CompanionError, match="/dev/stdout"):
        check_writable(Path("-"))
    assert not any(tmp_path.iterdir())


def test_an_empty_file_is_a_name_somebody_chose(tmp_path: Path) -> None:
    (tmp_path / "result").touch()
    check_writable(tmp_path / "result")
    write_json(tmp_path / "result", {"a": 1})
    assert (tmp_path / "result").read_text().startswith("{")


def test_a_command_keeps_the_log_that_its_result_was_to_replace(tmp_path: Path) -> None:
    log = tmp_path / "r.dat"
    before = _HELD["csi.dat"]
    log.write_bytes(before)
    done = CliRunner().invoke(program, ["csi", str(log), "--json", str(log)])
    assert isinstance(done.exception, CompanionError) and "is there already" in str(done.exception)
    assert log.read_bytes() == before
