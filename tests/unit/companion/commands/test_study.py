"""`companion study`: what it prints, leaves behind and refuses."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from numpy.random import SeedSequence

from companion.cli import main
from companion.study.catalogue import MODULES, study
from companion.study.rendezvous_rows import MissionRow
from tests.browser import visit


def _command(monkeypatch: pytest.MonkeyPatch, *arguments: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["companion", "study", *map(str, arguments)])
    try:
        main()
    except SystemExit as exit_:
        return int(exit_.code or 0)
    return 0


def test_command_prints_both_numbers_and_its_seed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out, result = tmp_path / "out", tmp_path / "crb.json"
    assert _command(monkeypatch, "crb", "--out", out, "--json", result, "--seed", "5", "--jobs", "1") == 0
    shown = capsys.readouterr().out
    assert "ours" in shown
    assert "paper" in shown
    assert "seed 5" in shown
    assert (out / "crb.png").is_file()
    content = json.loads(result.read_text())
    assert (content["study"], content["seed"], content["trials"]) == ("crb", 5, 6)
    assert any(row["theta_deg"][-1] is None for row in content["rows"])  # infinite


def test_command_without_recordings_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert _command(monkeypatch, "vio", "--data", tmp_path / "nowhere", "--out", tmp_path) == 1
    assert "nowhere" in capsys.readouterr().err
    assert _command(monkeypatch, "nonsense") == 2
    assert _command(monkeypatch, "crb", "--cluster", "local:none", "--out", tmp_path) == 2
    assert _command(monkeypatch, "crb", "--scenes", "hall", "--out", tmp_path) == 2
    assert _command(monkeypatch, "crb", "--motion", "fixed", "--out", tmp_path) == 2
    assert _command(monkeypatch, "crb", "--truths", "drawn", "--out", tmp_path) == 2
    capsys.readouterr()
    assert _command(monkeypatch, "rendezvous", "--scenes", "hall,hell", "--out", tmp_path) == 2
    assert "'hell' is unknown; expected one of open, hall" in capsys.readouterr().err


def test_a_run_that_was_cut_short_goes_on_and_writes_its_page(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    row = MissionRow(
        scene="hall", number=0, time_s=50.0, straight_s=25.0, end="arrived", closest_m=1.0, reached_s=40.0,
        arrived_m=1.0, left_room=False, draws_truths=False, steps=[],
    )  # fmt: skip
    flown: list[int] = []

    class Runner:
        name = "a test"

        def run(self, trial: Any, specs: Sequence[Any], seed: int, on_done: Any) -> list[MissionRow]:
            rows = [replace(row, number=spec.number, arrived_m=1.0 + spec.number) for spec in specs]
            flown.append(len(rows))
            on_done(0, rows)
            return rows

    monkeypatch.setattr("companion.commands.study.ProcessRunner", lambda jobs: Runner())
    result, page = tmp_path / "result.json", tmp_path / "page.md"
    for trials in ("2", "4"):
        arguments = ("rendezvous", "--scenes", "hall", "--trials", trials, "--out", tmp_path / "out")
        assert _command(monkeypatch, *arguments, "--json", result, "--markdown", page) == 0
    assert flown == [2, 2]
    content = json.loads(result.read_text())
    assert [each["number"] for each in content["rows"]] == [0, 1, 2, 3]
    hall = content["scenes"]["hall"]
    assert (hall["missions"], hall["success"], hall["false_arrival"], hall["unsaid"]) == (4, 0.5, 0.25, 0.25)
    assert hall["overhead"] == 2.0
    assert "| hall | 4 | 50 (15-85) |" in page.read_text()


@pytest.mark.long
def test_all_makes_one_page_and_goes_on_without_recordings(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    chosen = {name: MODULES[name] for name in ("crb", "vio")}
    monkeypatch.setattr("companion.commands.study.MODULES", chosen)
    result = tmp_path / "all.json"
    assert _command(monkeypatch, "all", "--out", tmp_path, "--json", result, "--data", tmp_path / "nowhere") == 0
    assert "vio: left out" in capsys.readouterr().out
    page = (tmp_path / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 1
    assert "vio left out" in page
    assert [outcome["study"] for outcome in json.loads(result.read_text())] == ["crb"]
    seen = visit((tmp_path / "report.html").as_uri(), tmp_path / "browser")
    assert (seen.console, seen.outside) == ([], [])
    assert seen.dom.count("<img") == 1


def test_recordings_of_which_none_can_be_used_are_a_failure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rx = tmp_path / "data" / "csi_rx_2021-06-27_203220.dat"
    rx.parent.mkdir()
    for name in (rx.name, "csi_tx1_2021-06-27_203220.dat"):
        (rx.parent / name).write_bytes(bytes(50))
    for name in ("rx_trajectory_2021-06-27_203220_.csv", "t265_rx_trajectory2021-06-27_203220.csv"):
        (rx.parent / name).touch()
    assert _command(monkeypatch, "vio", "--data", rx.parent, "--out", tmp_path, "--jobs", "1") == 1
    shown = capsys.readouterr().err
    assert "none of 1 trials gave a result" in shown
    assert rx.name in shown


def _no_trial(spec: object, seed: SeedSequence) -> float:
    raise ValueError("thirteen")


@pytest.mark.long
def test_all_goes_on_after_a_study_that_failed_and_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    studies = {"packets": replace(study("packets"), trial=_no_trial), "crb": study("crb")}
    monkeypatch.setattr("companion.commands.study.MODULES", studies)
    monkeypatch.setattr("companion.commands.study.load_study", studies.get)
    assert _command(monkeypatch, "all", "--trials", "1", "--out", tmp_path) == 1
    assert "packets failed: trial 0 (seed 1): ValueError: thirteen" in capsys.readouterr().err
    page = (tmp_path / "report.html").read_text()
    assert "packets failed: trial 0 (seed 1): ValueError: thirteen" in page
    assert page.count("data:image/png;base64,") == 1


def test_a_place_that_cannot_be_written_is_told_before_the_work(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    for out, result in (("file/out", "x.json"), ("out", "file/x.json")):
        assert _command(monkeypatch, "crb", "--out", tmp_path / out, "--json", tmp_path / result) == 1
        shown = capsys.readouterr()
        assert str(tmp_path / "file") in shown.err
        assert "cannot be written" in shown.err
        assert not shown.out
    assert not (tmp_path / "file").read_bytes()
