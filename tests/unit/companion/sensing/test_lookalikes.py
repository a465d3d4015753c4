"""Fingerprints on real channels: one transmitter under two names looks alike, two transmitters never do."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest

from companion.analysis import bearings
from companion.analysis.bearings import analyze_run
from companion.analysis.result import Options
from companion.analysis.runs import find_runs
from companion.analysis.trajectories import PoseKind
from companion.sensing.lookalikes import ALIKE, Lookalikes, likeness, outstanding
from tests.csi_records import needs_data
from tests.paths import DATA
from wsr.aperture import Aperture, make_aperture
from wsr.directions import Profile
from wsr.estimators import ESTIMATORS


@needs_data
def test_halves_of_the_packets_are_one_transmitter_and_others_are_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every second packet of each transmitter is taken for another identity of it."""
    halves: list[float] = []
    whole = make_aperture

    def halved(*columns: Any, **more: Any) -> Aperture:
        t_s, p_m, channel, wavelength_m = columns
        profiles = []
        for first in (0, 1):
            part = slice(first, None, 2)
            kept = {name: values[part] if np.ndim(values) else values for name, values in more.items()}
            aperture = whole(t_s[part], p_m[part], channel[part], wavelength_m, **kept)
            profiles.append(fingerprint(ESTIMATORS["robust"]().estimate(aperture)[1]))
        halves.append(likeness(*profiles))
        return whole(*columns, **more)

    monkeypatch.setattr(bearings, "make_aperture", halved)
    others: list[float] = []
    for run in find_runs(DATA / "wsr_dataset_dev" / "NLOS_Set_A")[:2]:
        links = analyze_run(run, Options(kind=PoseKind.MOCAP)).links
        profiles = [fingerprint(link.profile) for link in links if link.profile is not None]
        others += [likeness(a, b) for a, b in combinations(profiles, 2)]
    assert len(halves) == len(others) == 6
    assert max(others) < 0.6 < ALIKE
    assert sum(value > ALIKE for value in halves) >= 5


def fingerprint(profile: Profile | None) -> Any:
    assert profile is not None
    return outstanding(np.asarray(profile.power, np.float32).ravel())


def test_one_transmitter_behind_two_names_is_reported_after_several_apertures() -> None:
    rng = np.random.default_rng(1)

    def profile(seed: int, noise: float = 0.02) -> bytes:
        peak = np.zeros((180, 360))
        row, column = 40 + 17 * seed, 30 + 61 * seed
        peak[row - 8 : row + 8, column - 8 : column + 8] = 1.0
        return (peak + noise * rng.random((180, 360))).astype(np.float16).tobytes()

    looks = Lookalikes({2: "a", 3: "b", 4: "c"})
    for number in range(3):
        assert looks.pairs() == ()
        looks.add(2, number, number, profile(1))
        doubt = looks.add(3, number, number, profile(1))
        looks.add(4, number, number, profile(3))
    assert looks.pairs() == (("a", "b"),)
    assert "that of a" in doubt
    looks.add(2, 9, 9, profile(1))
    assert looks.add(3, 9, 9, profile(2)) == ""
    assert looks.pairs() == ()
    assert looks.add(4, 10, 10, b"") == ""


def test_apertures_that_share_packets_are_alike_for_that() -> None:
    power = np.zeros((180, 360), np.float16)
    power[40:60, 40:60] = 1.0
    looks = Lookalikes({2: "a", 3: "b"})
    for start in range(9):  # each shares three quarters of its time with the one before
        looks.add(2, start, start + 4, power.tobytes())
        looks.add(3, start, start + 4, power.tobytes())
        assert looks.pairs() == ((("a", "b"),) if start >= 8 else ())
