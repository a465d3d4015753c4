"""A rover's set points, and the path under them: in the plane, and bent so that both sides of it are told apart."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.config.schema import MissionConfig
from companion.core.clock import NS_PER_S
from companion.core.messages import Setpoint, Vector3
from companion.guidance.approach import Approach
from companion.guidance.ground import above_horizon, in_plane
from companion.guidance.steering import Aim
from companion.guidance.tracker import TargetTracker
from companion.safety.gate import GateLimits
from companion.sensing.records import Bearing
from wsr.aoa import AoaEstimate
from wsr.aperture import Aperture
from wsr.estimators import ESTIMATORS

_LIMITS = GateLimits(
    fence_min_m=(-50, -50, -1), fence_max_m=(50, 50, 10), fence_radius_m=60.0, max_speed_m_s=1.0, max_climb_m_s=0.7,
    max_acceleration_m_s2=3.0, min_height_m=0.5, on_ground=True,
)  # fmt: skip
_HERE: Vector3 = (3.0, -2.0, 0.1)


def test_it_is_told_a_velocity_in_the_plane_and_to_stand_a_place() -> None:
    assert in_plane(Setpoint(7, _HERE, (0.3, -0.1, 0.2), 1.0), _HERE, _LIMITS) == Setpoint(
        7, None, (0.3, -0.1, 0.0), None
    )
    behind = in_plane(Setpoint(7, (3.5, -2.0, 0.9), (0.3, -0.1, 0.0), 1.0), _HERE, _LIMITS)
    assert behind.p_local_enu_m is None
    assert behind.v_local_enu_m_s == pytest.approx((0.7, -0.1, 0.0)), "it is led back to its path"
    stops = in_plane(Setpoint(7, (3.5, -2.0, 0.1), (0.03, -0.03, 0.4), 1.0), _HERE, _LIMITS)
    assert stops == Setpoint(7, _HERE, (0.0, 0.0, 0.0), None), "and not led on, where the path stands"


def _path(aim: Aim | None, rate_hz: int = 20) -> np.ndarray:
    approach = Approach(MissionConfig(vehicle="rover", acceleration_m_s2=0.4, speed_m_s=0.4), _LIMITS, 1.2)
    approach.start((0.0, 0.0, 0.1), 0.0, 0.1)
    places = [approach.setpoint(k * NS_PER_S // rate_hz, aim, True).p_local_enu_m for k in range(15 * rate_hz)]
    return np.array(places)


@pytest.mark.parametrize(
    "aim",
    [
        Aim(azimuth_rad=0.5, distance_m=20.0, distance_std_m=8.0, sureness=0.2),
        Aim(azimuth_rad=0.5, distance_m=20.0, distance_std_m=0.5, sureness=1.0),
        None,
    ],
)
def test_its_path_stays_level_and_is_no_line(aim: Aim | None) -> None:
    path_m = _path(aim)
    assert np.ptp(path_m[:, 2]) == 0.0, "and nothing of the least height lifts it"
    newest_m = path_m[-60:, :2] - path_m[-60:, :2].mean(axis=0)
    along, across = np.linalg.svd(newest_m, compute_uv=False) / math.sqrt(len(newest_m))
    assert along > 0.2 and across > 0.03


_WAVELENGTH_M = 0.0541
_FLYING_M: Vector3 = (6.0, 5.0, 3.0)


def _estimated(target_m: Vector3, path_m: np.ndarray, seed: int) -> AoaEstimate:
    """Of the aperture of a rover's path, by the estimator that is the default."""
    rng = np.random.default_rng(seed)
    away_m = np.linalg.norm(path_m - np.array(target_m), axis=1)
    noise = 0.05 * (rng.normal(size=len(path_m)) + 1j * rng.normal(size=len(path_m)))
    aperture = Aperture(
        t_s=np.arange(len(path_m)) / 100.0,
        chi_m=path_m - path_m.mean(axis=0),
        channel=np.exp(-4j * np.pi * away_m / _WAVELENGTH_M) + noise,
        wavelength_m=_WAVELENGTH_M,
        reference_p_m=tuple(path_m.mean(axis=0).tolist()),
        reference_t_s=len(path_m) / 200.0,
    )
    return ESTIMATORS["robust"]().estimate(aperture)[0]


@pytest.mark.parametrize("target_m", [(9.0, 4.0, 0.4), (4.0, 9.0, 1.5), (6.0, 5.0, 2.0), (6.0, 5.0, 3.0)])
def test_azimuth_is_as_in_the_air_and_elevation_is_known_but_for_its_sign(target_m: Vector3) -> None:
    path_m = _path(
        Aim(azimuth_rad=math.atan2(target_m[1], target_m[0]), distance_m=20.0, distance_std_m=0.3, sureness=1.0),
        rate_hz=60,
    )[360:540]
    found = _estimated(target_m, path_m, 1)
    assert np.ptp(path_m[:, 2]) == 0.0 and found.azimuth_observable
    east, north, up = (there - here for there, here in zip(target_m, path_m.mean(axis=0).tolist(), strict=True))
    azimuth_rad, polar_rad = math.atan2(north, east), math.acos(up / math.hypot(east, north, up))
    assert math.degrees(abs(math.remainder(found.azimuth_rad - azimuth_rad, math.tau))) < 1.0
    assert math.degrees(abs(min(found.polar_rad, math.pi - found.polar_rad) - polar_rad)) < 4.0


def test_a_robot_in_the_air_is_found_above_though_its_image_below_was_reported() -> None:
    tracker = TargetTracker()
    for turn in range(10):
        here_m: Vector3 = (0.6 * turn, 0.5 * math.sin(turn), 0.0)
        east, north, up = (there - here for there, here in zip(_FLYING_M, here_m, strict=True))
        polar_rad = math.acos(up / math.hypot(east, north, up))
        told = Bearing(
            t_mono_ns=turn * NS_PER_S, p_local_enu_m=here_m, azimuth_rad=math.atan2(north, east),
            polar_rad=polar_rad if turn % 2 else math.pi - polar_rad, azimuth_std_rad=0.02, polar_std_rad=0.05,
            target_p_enu_m=(0.0, 0.0, 0.0), target_boot=1, reliability=0.9,
        )  # fmt: skip
        assert above_horizon(told).polar_rad == pytest.approx(polar_rad)
        found = tracker.add(above_horizon(told), 0.0)
    assert found.origin_local_enu_m == pytest.approx(_FLYING_M, abs=1.0)
