"""Recorded runs as logs: imported, replayed and reported they give the bearings that `companion analyze` gives."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from companion.analysis.bearings import OUTSIDE, analyze_run
from companion.analysis.exchanges import ExchangeError
from companion.analysis.imported import analyze_session, export_run, import_run
from companion.analysis.result import Options
from companion.analysis.runs import RecordingError, Run, find_runs, loose_run
from companion.analysis.summary import as_json
from companion.cli import main
from companion.errors import CompanionError
from companion.log.reader import metadata_of, open_session
from companion.log.repair import copy
from companion.log.writer import LogWriter
from companion.sim.sample import write_sample
from tests.csi_records import needs_data
from tests.faults.campaigns import FULL, recordings
from tests.synthetic_run import TX_MAC, RunFolder


@pytest.fixture
def run_cli(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    def cli(*arguments: str | Path) -> str:
        monkeypatch.setattr(sys, "argv", ["companion", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_:
            main()
        captured = capsys.readouterr()
        assert not exit_.value.code, captured.err
        return captured.out

    return cli


def links(result: Any) -> list[dict[str, Any]]:
    return as_json([result])["runs"][0]["links"]  # type: ignore[index, no-any-return]


def test_a_run_comes_back_from_its_log_and_gives_the_same_bearing(run: RunFolder, tmp_path: Path) -> None:
    (found,) = find_runs(run.folder)
    log = tmp_path / "run.mcap"
    import_run(found, log, Options())
    result = analyze_session(open_session(log))
    assert links(result) == links(analyze_run(found, Options()))
    for link in result.links:
        assert link.times is not None
        unpaired = sum(count for reason, count in link.dropped.items() if reason != OUTSIDE)
        assert (len(link.times.heard_s), len(link.times.paired_s)) == (link.packets, link.packets - unpaired)
        assert len(link.times.used_s) == len(link.times.paired_s) - link.dropped.get(OUTSIDE, 0) > 0
    back, scene = export_run(open_session(log), tmp_path / "back")
    assert back.rx is not None
    assert found.rx is not None
    assert back.rx.read_bytes() == found.rx.read_bytes()[: back.rx.stat().st_size]
    assert (back.stamp, back.set_name, scene.problems) == (found.stamp, found.set_name, ())


def test_an_ax_cards_recording_gives_its_own_files_back(tmp_path: Path) -> None:
    """FeitCSI's records have no frame around them: with that of the CSI tool each would be damaged."""
    write_sample(tmp_path / "wide", 1, 20)
    (found,) = find_runs(tmp_path / "wide")
    import_run(found, tmp_path / "run.mcap", Options())
    back, _ = export_run(open_session(tmp_path / "run.mcap"), tmp_path / "back")
    assert found.rx is not None and back.rx is not None and back.rx.name == found.rx.name
    assert back.rx.read_bytes() == found.rx.read_bytes()
    assert {name: path.read_bytes() for name, path in back.tx.items()} == {
        name: path.read_bytes() for name, path in found.tx.items()
    }


def test_the_commands_import_replay_and_report(run: RunFolder, tmp_path: Path, run_cli: Callable[..., str]) -> None:
    cli = run_cli
    cli("log", "import", run.folder, "--out", tmp_path / "logs")
    (log,) = (tmp_path / "logs").iterdir()
    cli("replay", log, "--json", tmp_path / "replay.json", "--out", tmp_path / "pictures")
    (found,) = find_runs(run.folder)
    content = json.loads((tmp_path / "replay.json").read_text())
    assert content["runs"][0]["links"] == json.loads(json.dumps(links(analyze_run(found, Options()))))
    assert list((tmp_path / "pictures").glob("*.png"))
    cli("report", log, "-o", tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 3
    assert "packet and pairing rates of each transmitter" in page
    assert "http" not in page
    assert cli("log", "export", log, "--out", tmp_path / "files").count(".dat") >= 2
    assert cli("log", "export", log, "--to", "tum", "--out", tmp_path / "tum").count(".tum") >= 1
    assert {path.suffix for path in (tmp_path / "tum").rglob("*.*")} == {".tum"}


def test_a_loose_file_that_cannot_be_read_is_no_recording(run: RunFolder, tmp_path: Path) -> None:
    (found,) = find_runs(run.folder)
    assert found.rx is not None
    (tmp_path / "empty.csv").touch()
    loose = loose_run(found.rx, tuple(found.tx.values()), tmp_path / "empty.csv")
    with pytest.raises(RecordingError, match=r"empty\.csv"):
        import_run(loose, tmp_path / "run.mcap", Options())


def test_ends_that_are_swapped_are_not_imported(run: RunFolder, tmp_path: Path) -> None:
    (found,) = find_runs(run.folder)
    swapped = replace(found, rx=run.tx, tx={"tx2": run.rx})
    for run_, options in ((swapped, Options()), (replace(swapped, tx={"own": run.rx}), Options(macs={"own": TX_MAC}))):
        with pytest.raises(ExchangeError, match=r"the ends look swapped: |are the ends swapped"):
            import_run(run_, tmp_path / "run.mcap", options)
    assert not (tmp_path / "run.mcap").exists()
    run.rx.write_bytes(b"")
    with pytest.raises(RecordingError, match="empty file"):
        import_run(found, tmp_path / "run.mcap", Options())


@needs_data
@pytest.mark.parametrize("found", recordings(first=True))
def test_fault_00_a_recording_imported_replayed_and_reported_gives_the_same_bearings(
    found: Run, tmp_path: Path, run_cli: Callable[..., str]
) -> None:
    run_cli("log", "import", found.folder, "--run", found.stamp, "--out", tmp_path / "logs")
    (log,) = (tmp_path / "logs").iterdir()
    analysed = json.loads(json.dumps(links(analyze_run(found, Options()))))
    assert analysed
    for command, page in (("replay", ()), ("report", ("-o", tmp_path / "report.html"))):
        if command == "report" or FULL:  # both estimate by the same function
            run_cli(command, log, *page, "--json", tmp_path / "result.json")
            assert json.loads((tmp_path / "result.json").read_text())["runs"][0]["links"] == analysed
    assert "data:image/png;base64," in (tmp_path / "report.html").read_text()


def test_a_recording_that_has_lost_its_csi_says_so(run: RunFolder, tmp_path: Path) -> None:
    (found,) = find_runs(run.folder)
    log, poses = tmp_path / "run.mcap", tmp_path / "poses.mcap"
    import_run(found, log, Options())
    with poses.open("wb") as file:
        writer = LogWriter(file, open_session(log).metadata)
        writer.add_metadata("recording", metadata_of(log)["recording"])
        for message in open_session(log).messages():
            if not message.topic.endswith("/csi"):
                copy(writer, message)
        writer.finish()
    with pytest.raises(CompanionError, match=rf"^run {found.stamp}: its log holds no CSI$"):
        analyze_session(open_session(poses))


def test_a_damaged_log_is_imported_and_said_to_be(run: RunFolder, tmp_path: Path) -> None:
    content = bytearray(run.rx.read_bytes())
    content[2000:2100] = bytes(100)
    run.rx.write_bytes(content)
    (found,) = find_runs(run.folder)
    (problem,) = import_run(found, tmp_path / "a.mcap", Options()).problems
    assert re.fullmatch(rf"{run.rx}: \d malformed records, \d+ bytes skipped", problem)


@pytest.mark.parametrize("key", ["stamp", "set_name", "folder"])
@pytest.mark.parametrize("name", ["../../out", "/tmp/out", ".."])
def test_a_recording_writes_no_file_outside_of_its_folder(run: RunFolder, tmp_path: Path, key: str, name: str) -> None:
    log = tmp_path / "run.mcap"
    scene = {"stamp": "s", "set_name": "s", "folder": "f", "loose": False, "channel": 108, key: name}
    with log.open("wb") as file:
        writer = LogWriter(file, {"role": "recording", "name": "s"})
        writer.add_metadata("recording", {"scene": json.dumps(scene)})
        writer.finish()
    with pytest.raises(CompanionError, match="expected a name, no path"):
        export_run(open_session(log), tmp_path / "a" / "b")
    assert not (tmp_path / "a").exists()
