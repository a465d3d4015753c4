"""Messages of a log as ROS has them, one by one."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest

from companion.log.reader import LoggedMessage
from companion.log.ros2_messages import Messages, _ellipsoid
from tests.bags import STORE


@pytest.mark.parametrize("seed", range(20))
def test_an_ellipsoid_has_the_axes_of_its_covariance(seed: int) -> None:
    chance = np.random.default_rng(seed)
    root = chance.normal(size=(3, 3))
    covariance = np.diag(chance.uniform(0.1, 4, 3)) if seed < 6 else root @ root.T
    (w, x, y, z), std_m = _ellipsoid(covariance)
    assert w * w + x * x + y * y + z * z == pytest.approx(1.0)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    np.testing.assert_allclose(turn @ np.diag(std_m**2) @ turn.T, covariance, atol=1e-9)


def test_inertial_data_are_turned_to_forward_left_up_and_east_north_up() -> None:
    made = Messages(STORE.types)

    def of(topic: str, content: dict[str, float]) -> list[Any]:
        logged = LoggedMessage(topic=topic, log_time_ns=9, data=msgspec.json.encode(content), publish_time_ns=9)
        return [message for _, _, message in made.of("", topic, logged)]

    sensed = {f"gyro_rad[{n}]": 0.1 * (n + 1) for n in range(3)}
    sensed |= {f"accelerometer_m_s2[{n}]": value for n, value in enumerate((0.2, 0.3, -9.8))}
    (before,) = of("/px4/sensor_combined", sensed)
    assert before.orientation_covariance[0] == -1, "not known yet"
    north = {f"q[{n}]": value for n, value in enumerate((1.0, 0.0, 0.0, 0.0))}
    assert of("/px4/vehicle_attitude", north) == []
    (imu,) = of("/px4/sensor_combined", sensed)
    force, turn = imu.linear_acceleration, imu.angular_velocity
    assert (force.x, force.y, force.z) == (0.2, -0.3, 9.8), "upwards when it rests"
    assert (turn.x, turn.y, turn.z) == pytest.approx((0.1, -0.2, -0.3))
    q = imu.orientation
    assert 2 * math.atan2(q.z, q.w) % math.tau == pytest.approx(math.pi / 2), "the nose to the North"
    assert (q.x, q.y) == pytest.approx((0, 0)) and imu.header.frame_id == "body"
