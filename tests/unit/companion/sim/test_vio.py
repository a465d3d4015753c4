"""The simulated tracking camera: axes, and errors of the size a T265 has."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.sim.scenario import VioScenario
from companion.sim.trajectory import Array
from companion.sim.vio import Camera
from tests.sim_scenes import STEADY_VIO, weave
from wsr import frames
from wsr.geometry import yaw_of

PERIOD_NS = 5_000_000


def _seen(camera: Camera, p_enu_m: Array, yaw_rad: Array, frame_yaw_rad: float) -> tuple[Array, Array, Array]:
    """Positions (N, 3), yaw (N,), velocities (N, 3) as the service understands the poses."""
    poses = [
        camera.pose(k * PERIOD_NS, (p[0], p[1], p[2]), yaw)
        for k, (p, yaw) in enumerate(zip(p_enu_m.tolist(), yaw_rad.tolist(), strict=True))
    ]
    attitude = frames.enu_from_t265_quaternion([pose.quaternion_wxyz for pose in poses])
    return (
        frames.yaw_align(frame_yaw_rad, frames.enu_from_t265_vector([pose.position_m for pose in poses])),
        np.asarray(yaw_of(frames.yaw_align(frame_yaw_rad, attitude))),
        frames.yaw_align(frame_yaw_rad, frames.enu_from_t265_vector([pose.velocity_m_s for pose in poses])),
    )


def _flight(path_m: float, heading_rad: float = 0.6) -> tuple[Array, Array]:
    """A woven flight at 0.4 m/s along `path_m`, sampled at 200 Hz."""
    legs = round(path_m / 1.2)
    count = round(path_m / 0.4 * 200)
    leg = weave(heading_rad)
    share = np.linspace(0.0, legs, count, endpoint=False)
    time_s = leg.t_s[0] + (share % 1.0) * np.ptp(leg.t_s)
    p_enu_m, _ = leg.at(time_s)
    ahead = np.array([math.cos(heading_rad), math.sin(heading_rad), 0.0])
    return p_enu_m + np.outer(1.2 * np.floor(share), ahead), np.full(count, heading_rad)


def _errors(seed: int, path_m: float, vio: VioScenario) -> Array:
    """Position errors (N, 3) against truth, both from their start."""
    p_enu_m, yaw_rad = _flight(path_m)
    seen_m, _, _ = _seen(Camera(vio, seed, 0, 1.1), p_enu_m, yaw_rad, 1.1)
    errors_m: Array = seen_m - (p_enu_m - p_enu_m[0])
    return errors_m


def _ate_m(errors_m: Array) -> float:
    return float(np.sqrt(np.mean(np.sum((errors_m - errors_m.mean(axis=0)) ** 2, axis=1))))


@pytest.mark.parametrize("frame_yaw_rad", [0.0, 1.0, -2.5])
def test_a_perfect_camera_is_understood_exactly(frame_yaw_rad: float) -> None:
    leg = weave(2.0)
    p_enu_m, yaw_rad = leg.at(np.arange(1.0, 4.0, 0.005))
    seen_m, seen_yaw_rad, seen_m_s = _seen(Camera(STEADY_VIO, 3, 0, frame_yaw_rad), p_enu_m, yaw_rad, frame_yaw_rad)
    assert seen_m == pytest.approx(p_enu_m - p_enu_m[0], abs=1e-9)
    assert np.exp(1j * seen_yaw_rad) == pytest.approx(np.exp(1j * yaw_rad), abs=1e-6)
    assert seen_m_s[1:] == pytest.approx(np.diff(p_enu_m, axis=0) / 0.005, abs=1e-5)


def test_a_wrong_north_turns_the_path() -> None:
    p_enu_m, yaw_rad = _flight(1.2)
    seen_m, _, _ = _seen(Camera(STEADY_VIO, 3, 0, 0.0), p_enu_m, yaw_rad, math.pi / 2)
    east, north, _ = (p_enu_m[-1] - p_enu_m[0]).tolist()
    assert seen_m[-1, :2].tolist() == pytest.approx([-north, east])


def test_error_over_one_aperture_is_millimetres() -> None:
    ates_m = [_ate_m(_errors(seed, 1.2, VioScenario())) for seed in range(30)]
    print(f"median {1e3 * np.median(ates_m):.1f} mm, worst {1e3 * max(ates_m):.1f} mm")
    assert 0.006 < np.median(ates_m) < 0.018
    assert max(ates_m) < 0.045


@pytest.mark.long
def test_error_over_the_whole_way_is_a_few_percent() -> None:
    ends = [np.linalg.norm(_errors(seed, 15.6, VioScenario())[-1]) for seed in range(12)]
    assert 0.005 < np.median(ends) / 15.6 < 0.06


def test_at_rest_it_hardly_drifts() -> None:
    count = 200 * 10
    p_enu_m, yaw_rad = np.tile([3.0, 4.0, 0.1], (count, 1)), np.full(count, 0.3)
    seen_m, _, _ = _seen(Camera(VioScenario(), 5, 1, 0.0), p_enu_m, yaw_rad, 0.0)
    assert 0 < np.linalg.norm(seen_m[-1]) < 0.02


def test_each_robot_and_seed_drifts_in_its_own_way_repeatably() -> None:
    p_enu_m, yaw_rad = _flight(1.2)
    ends = [
        _seen(Camera(VioScenario(), seed, robot, 0.0), p_enu_m, yaw_rad, 0.0)[0][-1].tolist()
        for seed, robot in ((1, 0), (1, 0), (1, 1), (2, 0))
    ]
    assert ends[0] == ends[1]
    assert len({tuple(end) for end in ends}) == 3


def test_an_aperture_stays_coherent_with_drifting_poses() -> None:
    scale = 4 * math.pi / (299_792_458.0 / 5.54e9)
    coherence = []
    for seed in range(20):
        errors_m = _errors(seed, 1.2, VioScenario())
        coherence.append(abs(np.mean(np.exp(1j * scale * errors_m @ [0.8, 0.6, 0.0]))))
    print(f"median coherence {np.median(coherence):.2f}, worst {min(coherence):.2f}")
    assert 0.4 < np.median(coherence) < 0.99
