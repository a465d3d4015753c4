"""The studies: a few trials of each, what must hold of their numbers, and what the command leaves behind."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.random import SeedSequence

from companion.cli import main
from companion.study.angles import aoa_error
from companion.study.catalogue import MODULES, study
from companion.study.local import ProcessRunner
from companion.study.rendezvous_rows import MissionRow
from companion.study.report import draw, write_json, write_page
from companion.study.study import Outcome, Settings, Study
from companion.study.trials import Batch, run_batch, trial_seed
from tests import paths
from tests.browser import visit

DATA = paths.DATA
SEED = 1


def _rows(one: Study[Any, Any], specs: Sequence[Any], first: int = 0) -> list[Any]:
    """In this process, as a worker would."""
    return run_batch(one.trial, Batch(first, tuple(specs), SEED))


def _outcome(one: Study[Any, Any], rows: list[Any]) -> Outcome:
    summary = one.summarise(rows)
    return Outcome(
        study=one.name,
        title=one.title,
        figures=one.figures,
        seed=SEED,
        trials=len(rows),
        elapsed_s=0.0,
        findings=summary.findings,
        notes=summary.notes,
        scenes=summary.scenes,
        rows=rows,
    )


def _check_leftovers(one: Study[Any, Any], rows: list[Any], folder: Path) -> Outcome:
    """The picture can be drawn, and everything goes into JSON and the page."""
    outcome = _outcome(one, rows)
    picture = folder / f"{one.name}.png"
    draw(picture, one, outcome)
    assert picture.read_bytes().startswith(b"\x89PNG")
    write_json(folder / "result.json", outcome)
    assert json.loads((folder / "result.json").read_text())["study"] == one.name
    write_page(folder / "report.html", [outcome], {one.name: picture}, {})
    page = (folder / "report.html").read_text()
    assert "data:image/png;base64," in page
    assert all(finding.quantity.replace("<", "&lt;").replace("'", "&#x27;") in page for finding in outcome.findings)
    return outcome


def test_paper_measure_wraps_the_azimuth() -> None:
    error = aoa_error(math.radians(179), math.radians(93), math.radians(-179), math.radians(89))
    assert error.azimuth_deg == pytest.approx(2.0)
    assert error.paper_deg == pytest.approx(math.hypot(2.0, 4.0))
    assert error.great_circle_deg == pytest.approx(error.paper_deg, rel=0.01)


@pytest.mark.parametrize("name", list(MODULES))
def test_every_study_names_its_figures_and_plans_trials(name: str) -> None:
    one = study(name)
    assert one.name == name
    assert one.figures
    if name == "vio" and not DATA.is_dir():
        pytest.skip(f"{DATA} is not there")
    assert one.plan(Settings(2, DATA))


def test_crb_helix_beats_circle_at_the_90th_percentile_of_theta_and_a_line_has_no_bound(tmp_path: Path) -> None:
    one = study("crb")
    rows = _rows(one, one.plan(Settings(1, DATA)))
    for phase in ("known", "unknown"):
        helix, circle, line = (next(r for r in rows if (r.geometry, r.phase) == (g, phase)) for g in _GEOMETRIES)
        assert helix.at("theta", 0.9) < circle.at("theta", 0.9) < line.at("theta", 0.9) == math.inf
        assert line.infinite_share == 1.0
        assert math.isfinite(line.at("theta_alone", 0.5))
        assert math.isfinite(line.at("phi_alone", 0.5))
    outcome = _check_leftovers(one, rows, tmp_path)
    orders = {f.quantity: f.ours for f in outcome.findings if f.quantity.startswith("order")}
    assert orders["order by CRB_theta, phase unknown, 90th percentile"] == "helix < circle < line"
    assert orders["order by CRB_phi, phase known, median"] == "circle < helix < line"  # not the paper's


_GEOMETRIES = ("helix", "circle", "line")


def test_geometry_keeps_the_papers_order(tmp_path: Path) -> None:
    one = study("geometry")
    rows = _rows(one, one.plan(Settings(10, DATA)))
    outcome = _check_leftovers(one, rows, tmp_path)
    shares = [f.ours for f in outcome.findings if f.quantity.endswith("by the paper's measure")]
    line, curve, spatial = (float(share) for share in shares if share is not None)
    assert line < curve < spatial
    assert spatial >= 90.0
    bounds = {g: np.median([r.crb_deg for r in rows if r.geometry == g]) for g in ("2D line", "2D curve", "3D")}
    assert bounds["3D"] < bounds["2D curve"] < bounds["2D line"] == math.inf


def test_drift_grows_with_the_error_and_scales_it_to_the_ate(tmp_path: Path) -> None:
    from companion.study import drift

    one = study("drift")
    for case in (drift.DriftCase("3D helix", "random walk", 0.15), drift.DriftCase("2D circle", "velocity bias", 0.1)):
        error = drift._error(case, np.random.default_rng(3))
        assert math.sqrt(float(np.mean(np.sum(error**2, axis=1)))) == pytest.approx(case.ate_m)
        assert not error[0].any()
    _check_leftovers(one, _rows(one, one.plan(Settings(1, DATA))), tmp_path)
    # One error drawn, at two scales: the least-squares answer is in proportion to it.
    small, large = (
        one.trial(drift.DriftCase("3D helix", "random walk", ate), trial_seed(SEED, 0)) for ate in (0.05, 0.1)
    )
    ratio = large.errors["least squares"].polar_deg / small.errors["least squares"].polar_deg
    assert ratio == pytest.approx(2.0, rel=0.1)


def test_moving_ends_need_the_others_displacement_in_ones_own_axes(tmp_path: Path) -> None:
    one = study("moving-ends")
    rows = _rows(one, one.plan(Settings(3, DATA)))
    _check_leftovers(one, rows, tmp_path)
    helix = [row.errors for row in rows if row.scenario == "helix"]

    def median(variant: str) -> float:
        return float(np.median([errors[f"robust, {variant}"].great_circle_deg for errors in helix]))

    assert median("corrected") < 2.0
    assert median("own axes, turned to North") == pytest.approx(median("corrected"), abs=0.05)
    assert median("clocks 38 s apart, joined by the exchange") == pytest.approx(median("corrected"), abs=0.2)
    assert median("not corrected") > 2 * median("corrected")
    assert median("own axes, not turned") > 2 * median("corrected")
    assert median("clocks 5 s apart, joined by time") > 2 * median("corrected")


def test_packets_losses_are_as_asked_and_errors_come_with_refusals(tmp_path: Path) -> None:
    from companion.study import packets

    rng = np.random.default_rng(5)
    kept = packets._bursts(rng, 200_000, 0.5)
    assert np.mean(kept) == pytest.approx(0.5, abs=0.03)
    ends = np.count_nonzero(np.diff(kept.astype(int)) == 1)
    assert np.count_nonzero(~kept) / ends == pytest.approx(20, rel=0.1)
    one = study("packets")
    rows = _rows(one, one.plan(Settings(2, DATA)))
    _check_leftovers(one, rows, tmp_path)
    whole = next(r for row in rows for r in row.results if r.condition == "sparse pings")
    assert whole.packets > 400
    assert whole.error_deg["robust"] is not None
    sparsest = rows[0].results[-1]
    assert sparsest.packets < 25


def test_rendezvous_is_the_same_mission_whatever_else_is_flown(tmp_path: Path) -> None:
    one = study("rendezvous")
    (case,) = one.plan(Settings(1, DATA, ("hall",)))
    first = one.trial(case, trial_seed(SEED, 1))
    assert first == one.trial(case, trial_seed(SEED, 7))
    assert (first.end, first.succeeded, first.kept_silent, first.left_room) == ("arrived", True, False, False)
    assert first.closest_m <= first.arrived_m < 2.0
    assert 26.0 < first.straight_s < first.reached_s < first.time_s
    assert len(first.approach) > 3
    assert all(step.distance_m > 1.5 for step in first.approach)
    errors = [step.great_circle_deg for step in first.steps if step.great_circle_deg is not None]
    assert np.median(errors) < 10.0
    assert all(step.informativeness_deg is not None for step in first.steps if step.azimuth_deg is not None)
    assert any(step.belief is not None for step in first.steps)
    outcome = _check_leftovers(one, [first], tmp_path)
    assert outcome.scenes["hall"]["success"] == 1.0
    assert one.table is not None
    assert "| hall | 1 | 100 (20.7-100) | 0 (0-79.3) |" in one.table(outcome)


def test_rendezvous_shares_its_missions_out_to_scenes_in_turn() -> None:
    plan = study("rendezvous").plan(Settings(5, DATA, ("hard", "open")))
    assert [(case.scene, case.number) for case in plan] == [
        ("hard", 0), ("open", 0), ("hard", 1), ("open", 1), ("hard", 2),
    ]  # fmt: skip
    everywhere = study("rendezvous").plan(Settings(24, DATA))
    assert len({case.scene for case in everywhere}) == 12


@pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not there")
def test_vio_measures_a_real_tracker(tmp_path: Path) -> None:
    one = study("vio")
    rows = _rows(one, one.plan(Settings(1, DATA)))
    _check_leftovers(one, rows, tmp_path)
    (row,) = rows
    assert 0.0 < row.drift.ate_m < 0.3
    assert 0.3 < row.drift.length_m < 5.0
    assert {link.estimator for link in row.links} == {"bartlett", "robust"}


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
    capsys.readouterr()
    assert _command(monkeypatch, "rendezvous", "--scenes", "hall,hell", "--out", tmp_path) == 2
    assert "'hell' is unknown; expected one of open, hall" in capsys.readouterr().err


def test_a_run_that_was_cut_short_goes_on_and_writes_its_page(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    row = MissionRow(
        scene="hall", number=0, time_s=50.0, straight_s=25.0, end="arrived", closest_m=1.0, reached_s=40.0,
        arrived_m=1.0, left_room=False, steps=[],
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


def test_processes_give_what_this_one_gives() -> None:
    one = study("packets")
    specs = one.plan(Settings(1, DATA))
    assert ProcessRunner(1).run(one.trial, specs, SEED, lambda first, rows: None) == _rows(one, specs)
