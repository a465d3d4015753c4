"""An imported recording on the page: its path, and each transmitter's bearing with its profile."""

from __future__ import annotations

import json
import math
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.analysis.result import Direction, LinkResult, RunResult
from companion.analysis.runs import Run
from companion.analysis.trajectories import PoseKind
from companion.errors import CompanionError
from companion.replay import live_page, recording_page
from companion.replay.recording_page import show_recording
from wsr.aoa import AoaEstimate
from wsr.directions import AZIMUTH_RAD, POLAR_RAD, Profile

_PATH = np.stack([np.linspace(0, 1, 30), np.zeros(30), np.full(30, 0.2)], axis=1)


def link(name: str, azimuth_deg: float) -> LinkResult:
    azimuth = math.radians(azimuth_deg)
    estimate = AoaEstimate(
        azimuth_rad=azimuth, polar_rad=1.5, azimuth_std_rad=0.03, polar_std_rad=math.inf,
        covariance=((1e-3, 0, 0), (0, math.inf, 0), (0, 0, math.inf)), crb_rad=0.01, coherence=0.9, reliability=0.9,
        azimuth_observable=True, polar_observable=False, alternatives=(), packets=300, length_m=1.1,
        extents_m=(1.0, 0.5, 0.0), reference_p_m=(0.0, 0.0, 0.0), reference_t_s=0.0,
    )  # fmt: skip
    power = np.zeros((POLAR_RAD.size, AZIMUTH_RAD.size), np.float32)
    power[90, 200] = 1.0
    truth = Direction(azimuth - math.radians(2.0), 1.5)
    return LinkResult(
        name=name, packets=400, estimate=estimate, profile=Profile(power, AZIMUTH_RAD, POLAR_RAD), truth=truth
    )


def recording(*links: LinkResult) -> RunResult:
    return RunResult(run=Run(folder=Path("set"), stamp="now", rx=None), kind=PoseKind.MOCAP, links=links)


@pytest.mark.long
def test_every_transmitter_is_shown_with_its_profile(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_page, "_PATIENCE_S", 0.1)
    monkeypatch.setattr(recording_page, "_EACH_S", 0.5)
    url, seen = list[str](), list[dict[str, Any]]()

    def look() -> None:
        with urllib.request.urlopen(url[0] + "state", timeout=60) as answer:
            seen.append(json.loads(answer.read()))

    found = recording(link("tx2", 30.0), link("tx3", -100.0))
    path_m = np.vstack([_PATH, [[math.nan, 0.0, 0.0]]])
    show_recording(found, path_m, "set.mcap", 0, announce=url.append, stay=look)
    (state,) = seen
    assert state["view"]["ended"] and state["view"]["mission"]["state"] == "recording"
    assert state["view"]["health"] == []
    assert [bearing[2] for bearing in state["path"]["bearings"]] == [30.0, -100.0]
    assert len(state["path"]["trail"]) > 5
    assert state["profile"]["number"] == 2
    assert state["view"]["bearing"]["elevation_deg"] is None
    assert [line["text"] for line in state["view"]["events"]] == [
        "tx2: bearing 1: azimuth 30.0°, +2.0° off the truth", "tx3: bearing 2: azimuth -100.0°, +2.0° off the truth",
    ]  # fmt: skip


def test_without_a_bearing_there_is_nothing_to_show() -> None:
    with pytest.raises(CompanionError, match="no bearing to show"):
        show_recording(recording(), _PATH, "set.mcap", 0, announce=lambda url: None, stay=lambda: None)
