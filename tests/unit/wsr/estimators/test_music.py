"""MUSIC: channels of both directions made of distances, with detection delays, oscillator offsets and noise of each."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.far_field import FarField
from tests.unit.wsr.estimators.two_sources import APART, exchanged
from tests.unit.wsr.scene import DIRECTIONS, WAVELENGTH_M, Array, circle, far, round_trip, weave
from wsr.aoa import AoaEstimate
from wsr.aperture import Aperture, make_aperture
from wsr.errors import ApertureError
from wsr.estimators.music import Music
from wsr.estimators.source_number import source_number
from wsr.estimators.stretches import Stretch
from wsr.geometry import direction, great_circle


def _two(p: Array, seed: int) -> Aperture:
    return exchanged(p, (far(p, APART[0]), far(p, APART[1])), seed)


def _vector(estimate: AoaEstimate) -> Array:
    return direction(estimate.azimuth_rad, estimate.polar_rad)


def _error_deg(estimate: AoaEstimate, u: Array) -> float:
    return math.degrees(great_circle(_vector(estimate), u))


def _azimuth_errors_deg(estimate: AoaEstimate) -> list[float]:
    """Of each of the two sources, from the nearest path."""
    azimuths = [0.5, 0.5 + math.radians(25)]
    paths = np.array([path.azimuth_rad for path in estimate.paths])
    return [math.degrees(np.abs(np.angle(np.exp(1j * (paths - azimuth)))).min()) for azimuth in azimuths]


@pytest.mark.parametrize("neighbour", DIRECTIONS[::2])
def test_one_source_within_a_degree(neighbour: tuple[int, int, int]) -> None:
    u = np.array(neighbour) / np.linalg.norm(neighbour)
    _, p = weave()
    estimate, profile = Music().estimate(exchanged(p, (far(p, u),)))
    assert _error_deg(estimate, u) < 1.0
    assert len(estimate.paths) == 1
    assert estimate.coherence > 0.95
    assert profile.power.shape == (180, 360)
    assert float(profile.power.max()) == pytest.approx(estimate.paths[0].power, rel=1e-3)


def test_conjugated_channels_point_to_the_antipode() -> None:
    """The test above can fail: the other sign of the phase is the opposite direction."""
    _, p = weave()
    u = np.array([0.6, 0.64, 0.48])
    aperture = exchanged(p, (far(p, u),), offset_hz=0.0)
    assert aperture.forward is not None
    assert aperture.reverse is not None
    mistaken = replace(
        aperture,
        channel=aperture.channel.conj(),
        forward=aperture.forward.conj(),
        reverse=aperture.reverse.conj(),
    )
    estimate, _ = Music().estimate(mistaken)
    assert _error_deg(estimate, u) > 90.0
    assert _error_deg(estimate, -u) < 2.0


def test_two_sources_where_bartlett_reports_a_direction_between_them() -> None:
    """A level circle: the cross term of the product points halfway between the sources, in its plane's projection as
    good as a real direction, and is twice as strong as either."""
    _, p = circle()
    for seed in range(4):
        aperture = _two(p, seed)
        estimate, _ = Music().estimate(aperture)
        assert max(_azimuth_errors_deg(estimate)) < 3.0
        assert len(estimate.paths) == 2
        assert estimate.paths[1].relative_power > 0.5
        assert estimate.reliability < 0.5  # which of the two is the robot is not known
        bartlett, _ = FarField().estimate(aperture)
        middle = 0.5 + math.radians(12.5)
        assert bartlett.azimuth_rad == pytest.approx(middle, abs=math.radians(2))


def test_two_sources_over_a_path_in_space() -> None:
    _, p = weave()
    for seed in range(4):
        aperture = _two(p, seed)
        estimate, _ = Music().estimate(aperture)
        paths = [direction(path.azimuth_rad, path.polar_rad) for path in estimate.paths]
        assert all(min(math.degrees(great_circle(u, path)) for path in paths) < 1.0 for u in APART)
        bartlett, _ = FarField().estimate(aperture)
        assert min(_error_deg(bartlett, u) for u in APART) > 5.0


def test_level_circle_reports_the_upper_image_and_lists_the_lower() -> None:
    _, p = circle()
    for polar_deg in (60.0, 120.0):
        u = direction(math.radians(-110), math.radians(polar_deg))
        estimate, _ = Music().estimate(exchanged(p, (far(p, u),)))
        assert math.degrees(estimate.azimuth_rad) == pytest.approx(-110, abs=1)
        assert math.degrees(estimate.polar_rad) == pytest.approx(60, abs=2)
        assert math.degrees(estimate.alternatives[0].polar_rad) == pytest.approx(120, abs=2)
        assert len(estimate.paths) == 1  # the image is no second path
        assert estimate.azimuth_observable
        assert not estimate.polar_observable


def test_errors_are_as_large_as_the_estimate_says() -> None:
    """With poses that wander: few errors beyond three deviations, and deviations that are not simply large."""
    _, p = weave()
    u = np.array([0.6, 0.64, 0.48])
    ratios = []
    for seed in range(16):
        wander = np.cumsum(np.random.default_rng(seed).normal(size=p.shape), axis=0)
        wander *= 0.03 / np.sqrt(((wander - wander.mean(axis=0)) ** 2).sum(axis=1).mean())
        aperture = exchanged(p, (far(p, u),), seed)
        estimate, _ = Music().estimate(replace(aperture, chi_m=aperture.chi_m + wander - wander.mean(axis=0)))
        error = math.remainder(estimate.azimuth_rad - math.atan2(u[1], u[0]), math.tau)
        ratios.append(error / estimate.azimuth_std_rad)
    assert np.mean(np.abs(ratios) < 3) >= 0.9
    assert 0.2 < float(np.sqrt(np.mean(np.square(ratios)))) < 2.0


def test_noise_alone_is_not_reliable() -> None:
    _, p = weave()
    rng = np.random.default_rng(4)
    ahead, back = (rng.normal(size=(2, 600, 30)) + 1j * rng.normal(size=(2, 600, 30))).astype(np.complex64)
    t = np.linspace(0.0, 3.0, 600)
    estimate, _ = Music().estimate(
        make_aperture(t, p, (ahead * back).mean(axis=1), WAVELENGTH_M, forward=ahead, reverse=back)
    )
    assert estimate.reliability < 0.2
    assert estimate.azimuth_std_rad > math.radians(15)


def test_packets_without_a_signal_are_dropped() -> None:
    _, p = weave()
    u = np.array([0.6, 0.64, 0.48])
    aperture = exchanged(p, (far(p, u),))
    silent = np.random.default_rng(5).random(600) < 0.5
    assert aperture.forward is not None
    assert aperture.reverse is not None
    half = replace(
        aperture,
        channel=np.where(silent, 0, aperture.channel),
        forward=np.where(silent[:, None], 0, aperture.forward),
        reverse=np.where(silent[:, None], 0, aperture.reverse),
    )
    estimate, _ = Music().estimate(half)
    assert _error_deg(estimate, u) < 1.0
    assert estimate.dropped == {"no signal": int(silent.sum())}
    none = replace(half, channel=np.where(np.arange(600) < 15, aperture.channel, 0), forward=None, reverse=None)
    with pytest.raises(ApertureError, match="only 15 of 600 packets have a signal"):
        Music().estimate(none)


def test_what_comes_from_everywhere_is_no_path() -> None:
    """Many weak echoes stand out of white noise, so that MDL counts up to its limit; none of them is a path."""
    _, p = weave()
    rng = np.random.default_rng(8)
    u = np.array([0.6, 0.64, 0.48])
    around = [direction(*angles) for angles in zip(rng.uniform(-3, 3, 10), rng.uniform(0.5, 2.5, 10), strict=True)]
    aperture = exchanged(p, (far(p, u), *(far(p, v) for v in around)), others=0.2)
    counted: list[int] = []

    def counting(stretches: list[Stretch], largest: int) -> int:
        counted.append(source_number(stretches, largest))
        return counted[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wsr.estimators.music.source_number", counting)
        estimate, _ = Music().estimate(aperture)
    assert counted[-1] == 2
    assert len(estimate.paths) == 1
    assert _error_deg(estimate, u) < 5.0


def test_without_subcarriers_the_product_gives_one_path() -> None:
    t, p = weave()
    u = np.array([0.6, 0.64, 0.48])
    aperture = make_aperture(t, p, round_trip(p, far(p, u), 0.3), WAVELENGTH_M)
    estimate, _ = Music().estimate(aperture)
    assert _error_deg(estimate, u) < 1.0
    assert len(estimate.paths) == 1
    assert estimate.packets == 600


def test_packets_too_far_apart_for_a_chain_of_signs() -> None:
    """A third of a wavelength between packets leaves the sign of the one-way channel open, but not the product."""
    _, p = weave(100)
    u = np.array([0.6, 0.64, 0.48])
    estimate, _ = Music().estimate(exchanged(p, (far(p, u),)))
    assert _error_deg(estimate, u) < 1.0


def test_a_wait_does_not_move_the_reference_point() -> None:
    _, p = weave()
    u = np.array([0.6, 0.64, 0.48])
    waiting = np.vstack([np.repeat(p[:1], 600, axis=0), p])
    estimate, _ = Music().estimate(exchanged(waiting, (far(p, u),)))
    away = np.linalg.norm(waiting.mean(axis=0) - p.mean(axis=0))
    assert away > 0.1
    assert np.linalg.norm(estimate.reference_p_m - p.mean(axis=0)) < 0.2 * away


def test_an_aperture_of_too_few_places_is_refused() -> None:
    _, p = weave(20)
    near = p.mean(axis=0) + 1e-3 * (p - p.mean(axis=0))
    aperture = make_aperture(np.arange(20.0), near, np.ones(20), WAVELENGTH_M, min_length_m=0.0)
    with pytest.raises(ApertureError, match="1 places in 1 pieces"):
        Music().estimate(aperture)
