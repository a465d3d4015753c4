"""From the camera's axes to the local frame."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.camera.place import Mounting
from tests.unit.companion.camera.tags import TAG
from wsr.geometry import quaternion_from_yaw

_LEVEL = (1.0, 0.0, 0.0, 0.0)
_HERE = (10.0, 20.0, 2.0)


@pytest.mark.parametrize(
    ("mounted_deg", "expected_m"),
    [
        ((0.0, 0.0, 0.0), (3.0, -0.1, -0.2)),  # ahead, a little to the right and below
        ((90.0, 0.0, 0.0), (0.1, 3.0, -0.2)),  # looks to the left
        ((0.0, 90.0, 0.0), (-0.2, -0.1, -3.0)),  # looks down, its top ahead
        ((0.0, 0.0, 90.0), (3.0, 0.2, -0.1)),  # lies on its right side
    ],
)
def test_a_tag_is_where_the_mounted_camera_sees_it(
    mounted_deg: tuple[float, float, float], expected_m: tuple[float, float, float]
) -> None:
    mounting = Mounting((0.1, 0.0, -0.05), *map(math.radians, mounted_deg))
    seen = mounting.place(TAG, _HERE, _LEVEL)
    np.testing.assert_allclose(seen.p_local_enu_m, np.array(_HERE) + expected_m + (0.1, 0.0, -0.05), atol=1e-12)
    w, x, y, z = quaternion_from_yaw(math.pi / 2).tolist()
    turned = mounting.place(TAG, _HERE, (w, x, y, z)).p_local_enu_m - _HERE
    ahead, left, up = seen.p_local_enu_m - _HERE
    np.testing.assert_allclose(turned, (-left, ahead, up), atol=1e-12)


def test_the_deviation_grows_with_the_distance_and_with_an_ambiguous_pose() -> None:
    mounting = Mounting((0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    near = mounting.place(TAG, _HERE, _LEVEL)
    far = mounting.place(replace(TAG, p_camera_m=(0.1, 0.2, 6.0)), _HERE, _LEVEL)
    std_m = [np.sqrt(np.diag(place.covariance_m2)) for place in (near, far)]
    assert np.all(std_m[1] > 1.4 * std_m[0]) and np.all(std_m[0] > 0.05)
    doubtful = replace(TAG, other_p_camera_m=(0.1, 0.2, 3.4), other_error_px=0.06)
    assert mounting.place(doubtful, _HERE, _LEVEL).covariance_m2[0, 0] > near.covariance_m2[0, 0] + 0.03
    np.testing.assert_allclose(near.corners_m2, np.diag([4e-4, 1e-4, 1e-4]), atol=1e-12)
