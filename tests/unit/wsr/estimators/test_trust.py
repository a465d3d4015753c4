"""What an estimate is worth falls with all that speaks against it, and its figures are those documented."""

from __future__ import annotations

import math

import pytest

from wsr.estimators.trust import Evidence, model_error_rad, range_error_m, reliability


def evidence(coherence: float = 0.9, rival: float = 0.0, length: float = 40.0) -> Evidence:
    return Evidence(coherence=coherence, rival=rival, length_wavelengths=length)


def test_reliability_is_the_documented_curve() -> None:
    assert reliability(evidence(0.35)) == pytest.approx(0.5)
    assert reliability(evidence(0.49)) == pytest.approx(0.8, abs=0.01)
    assert reliability(evidence(0.1)) < 0.1
    assert reliability(evidence(0.9, rival=1.0)) < 0.03


def test_it_falls_with_a_rival_and_rises_with_coherence() -> None:
    rivals = [reliability(evidence(rival=share)) for share in (0.0, 0.2, 0.4, 0.8, 1.5)]
    assert rivals == sorted(rivals, reverse=True)
    coherent = [reliability(evidence(share)) for share in (0.0, 0.3, 0.6, 1.0)]
    assert coherent == sorted(coherent) and coherent[0] > 0.0 and coherent[-1] < 1.0


def test_what_noise_does_not_show_shrinks_with_length_to_what_the_poses_leave() -> None:
    errors = [model_error_rad(evidence(0.5, length=length)) for length in (0.5, 1.0, 10.0, 100.0, 1e6)]
    assert errors[0] == errors[1], "no longer than a wavelength: the lobe is no wider than all directions"
    assert errors[1:] == sorted(errors[1:], reverse=True)
    assert errors[-1] == pytest.approx(math.radians(1.0), rel=1e-3)
    assert model_error_rad(evidence(1.0)) == pytest.approx(math.radians(1.0))


def test_nothing_is_infinite_where_nothing_adds_up() -> None:
    for coherence in (0.0, 1e-6, 1.0, 1.1):
        assert math.isfinite(model_error_rad(evidence(coherence)))
        assert math.isfinite(range_error_m(evidence(coherence), 1.0))
    assert range_error_m(evidence(0.5), 4.0) == pytest.approx(2 * range_error_m(evidence(0.5), 1.0))
