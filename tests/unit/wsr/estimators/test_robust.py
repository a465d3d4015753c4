"""The robust estimator on channels made from distances."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from tests.paths import ROOT
from tests.unit.wsr.scene import WAVELENGTH_M, aperture_towards, circle, error_deg, exchange, round_trip, weave
from wsr.aoa import AoaEstimate
from wsr.aperture import make_aperture
from wsr.errors import ApertureError
from wsr.estimators.options import RobustOptions
from wsr.estimators.robust import Robust
from wsr.geometry import angles, direction, great_circle, wrap_angle

U = direction(2.1, 1.35)


def test_near_source_in_direction_and_range() -> None:
    t, p = weave(900)
    source = (p.mean(axis=0) + 4.0 * U)[None, :]
    estimate, profile = Robust().estimate(aperture_towards(t, p, source))
    assert error_deg(estimate, source) < 0.2
    assert estimate.range_observable
    assert estimate.range_m == pytest.approx(4.0, rel=0.1)
    assert estimate.azimuth_observable
    assert estimate.polar_observable
    assert estimate.alternatives == ()
    assert estimate.reliability > 0.5
    assert profile.power.shape == (180, 360)
    row, column = np.unravel_index(int(np.argmax(profile.power)), profile.power.shape)
    assert great_circle(direction(profile.azimuth_rad[column], profile.polar_rad[row]), U) < math.radians(3)


@pytest.mark.parametrize("range_m", [0.6, 0.8, 1.1])
def test_source_nearer_than_the_path_is_long(range_m: float) -> None:
    """Waves of a source so near look like those of none that is 2 m away."""
    t, p = weave(900)
    missed = 0
    for azimuth_rad in np.arange(0.0, math.tau, 0.7):
        source = (p.mean(axis=0) + range_m * direction(azimuth_rad, 2.0))[None, :]
        estimate, _ = Robust().estimate(aperture_towards(t, p, source))
        missed += error_deg(estimate, source) > 0.5 or estimate.range_m != pytest.approx(range_m, rel=0.05)
    assert missed <= 1  # of nine


def test_plane_waves_are_biased_where_spherical_ones_are_not() -> None:
    """A quarter of an ellipse, so that curvature does not cancel over the path."""
    s = np.linspace(0, 1, 700)[:, None]
    p = np.hstack([0.9 * s**2, 0.7 * np.sin(2.5 * s), 0.35 * np.sin(4 * s)])
    source = (p.mean(axis=0) + 2.5 * U)[None, :]
    aperture = aperture_towards(s[:, 0] * 4, p, source)
    flat, _ = Robust(RobustOptions(focus=False)).estimate(aperture)
    round_, _ = Robust().estimate(aperture)
    assert error_deg(round_, source) < 0.3
    assert error_deg(flat, source) > 2 * error_deg(round_, source)


def test_level_path_gives_azimuth_and_says_what_it_cannot() -> None:
    t, p = circle(900)
    source = (p.mean(axis=0) + 5.0 * direction(-1.9, math.radians(80)))[None, :]
    estimate, _ = Robust().estimate(aperture_towards(t, p, source))
    assert estimate.azimuth_rad == pytest.approx(-1.9, abs=math.radians(1))
    assert estimate.azimuth_observable
    assert not estimate.polar_observable
    assert estimate.covariance[1][1] == math.inf
    (image,) = estimate.alternatives
    assert image.polar_rad == pytest.approx(math.pi - estimate.polar_rad, abs=1e-3)


@pytest.mark.parametrize("polar_deg", [62, 68, 74])
@pytest.mark.parametrize("azimuth_deg", [-90, -45, 0, 135])
def test_near_source_above_a_long_level_path(polar_deg: float, azimuth_deg: float) -> None:
    s = np.linspace(0, 1, 400)
    p = np.stack([2.6 * s, 0.3 * np.sin(2 * np.pi * s), 0 * s], axis=1)
    source = (p.mean(axis=0) + 2.0 * direction(math.radians(azimuth_deg), math.radians(polar_deg)))[None, :]
    estimate, _ = Robust().estimate(aperture_towards(3 * s, p, source))
    off = wrap_angle(estimate.azimuth_rad - math.radians(azimuth_deg))
    assert abs(math.degrees(off)) < 2


@pytest.mark.parametrize("reach_m", [0.0, 0.02])
def test_packets_left_over_too_short_a_stretch_are_refused(reach_m: float) -> None:
    t, p = weave(600)
    p[:40] = p[0] + np.linspace(0, reach_m, 40)[:, None] * [1, 0, 0]
    forward, reverse = exchange(p, (p.mean(axis=0) + 5.0 * U)[None, :])
    rng = np.random.default_rng(3)
    reverse[40:] = rng.normal(size=(560, 30)) + 1j * rng.normal(size=(560, 30))
    aperture = make_aperture(t, p, (forward * reverse).mean(1), WAVELENGTH_M, forward=forward, reverse=reverse)
    with pytest.raises(ApertureError, match=r"40 of 600 packets are consistent, which span 0\.0\d+ m; needs .* 0\.108"):
        Robust().estimate(aperture)


@pytest.mark.parametrize("one_way", [True, False])
@pytest.mark.parametrize("unit", [1e-40, 1e40])
def test_product_in_any_unit(unit: float, one_way: bool) -> None:
    t, p = weave(600)
    source = (p.mean(axis=0) + 5.0 * U)[None, :]
    aperture = make_aperture(t, p, unit * round_trip(p, source), WAVELENGTH_M)
    assert error_deg(Robust(RobustOptions(one_way=one_way)).estimate(aperture)[0], source) < 0.5


def test_straight_path_claims_nothing() -> None:
    t = np.linspace(0, 3, 500)
    p = t[:, None] * np.array([0.4, 0.2, 0.0])
    estimate, _ = Robust().estimate(aperture_towards(t, p, (p.mean(axis=0) + 6 * U)[None, :]))
    assert not estimate.azimuth_observable
    assert not estimate.polar_observable
    assert estimate.crb_rad == math.inf


def test_first_path_wins_over_a_stronger_late_one() -> None:
    t, p = weave(900)
    source = (p.mean(axis=0) + 5.0 * U)[None, :]
    wall = p.mean(axis=0) + 14.0 * direction(-0.6, 1.5)
    forward, reverse = exchange(p, source, echo=(wall[None, :], 1.15))
    aperture = make_aperture(t, p, (forward * reverse).mean(1), WAVELENGTH_M, forward=forward, reverse=reverse)
    estimate, _ = Robust().estimate(aperture)
    assert error_deg(estimate, source) < 3.0
    late, _ = Robust(RobustOptions(delay_ns=None)).estimate(aperture)
    assert error_deg(late, source) > 20.0


@pytest.mark.parametrize(
    "options",
    [
        RobustOptions(one_way=False),
        RobustOptions(wideband=False),
        RobustOptions(path_bins=False),
        RobustOptions(unit_power=False),
        RobustOptions(scales=(1,)),
        RobustOptions(reciprocity=False, gate=True),
        RobustOptions(resign=False),
        RobustOptions(power_share=1.0),
    ],
)
def test_every_step_can_be_switched_off(options: RobustOptions) -> None:
    t, p = weave(600)
    source = (p.mean(axis=0) + 5.0 * U)[None, :]
    estimate, _ = Robust(options).estimate(aperture_towards(t, p, source))
    assert error_deg(estimate, source) < 0.5


def test_less_data_is_enough() -> None:
    t, p = weave(600)
    source = (p.mean(axis=0) + 5.0 * U)[None, :]
    full = aperture_towards(t, p, source)
    assert full.forward is not None
    assert full.reverse is not None
    one = replace(full, forward=full.forward[:, 14:15], reverse=full.reverse[:, 14:15])
    none = replace(full, forward=None, reverse=None, channel=one.forward[:, 0] * one.reverse[:, 0])  # type: ignore[index, arg-type]
    for aperture in (one, none):
        assert error_deg(Robust().estimate(aperture)[0], source) < 1.0


def test_noise_alone_is_not_reliable() -> None:
    t, p = weave(60)
    rng = np.random.default_rng(4)
    wild = (rng.normal(size=(2, 60, 30)) + 1j * rng.normal(size=(2, 60, 30))).astype(np.complex64)
    aperture = make_aperture(t, p, (wild[0] * wild[1]).mean(1), WAVELENGTH_M, forward=wild[0], reverse=wild[1])
    estimate, _ = Robust(RobustOptions(reciprocity=False)).estimate(aperture)
    assert estimate.reliability < 0.2


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(1, 5))])
def test_errors_stay_within_three_deviations(seed: int) -> None:
    t, p = weave(400)
    source = (p.mean(axis=0) + 6.0 * U)[None, :]
    estimate, _ = Robust().estimate(aperture_towards(t, p, source, noise=0.5, seed=seed))
    azimuth, polar = angles(source[0] - np.array(estimate.reference_p_m))
    assert abs(estimate.azimuth_rad - azimuth) < 3 * estimate.azimuth_std_rad
    assert abs(estimate.polar_rad - polar) < 3 * estimate.polar_std_rad


def test_estimate_goes_over_the_wire() -> None:
    t, p = weave(300)
    estimate, _ = Robust().estimate(aperture_towards(t, p, (p.mean(axis=0) + 6.0 * U)[None, :]))
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(estimate), type=AoaEstimate) == estimate


_DIGEST = """
import hashlib
from tests.unit.wsr.scene import WAVELENGTH_M, circle, exchange, weave
from wsr.aperture import make_aperture
from wsr.estimators.robust import Robust

found = hashlib.sha256()
for t, p in (weave(220), weave(900), circle(300)):
    there, back = exchange(p, p.mean(axis=0) + [[4.0, 3.0, -1.0]])
    aperture = make_aperture(t, p, (there * back).mean(axis=1), WAVELENGTH_M, forward=there, reverse=back)
    found.update(repr(Robust().estimate(aperture)[0]).encode())
print(found.hexdigest())
"""


@pytest.mark.long
def test_who_compiles_gives_the_last_digits_of_who_reads_the_cache(tmp_path: Path) -> None:
    """Else a flight whose worker found the cache empty would not replay as it was flown."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", _DIGEST]
    compiling, reading = (
        subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    )
    assert compiling == reading
