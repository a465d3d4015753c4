"""Corners from whole edges."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

cv2 = pytest.importorskip("cv2", reason="needs the extra apriltag")

from companion.camera.corners import square_corners  # noqa: E402

_SQUARE = np.array([(60.3, 50.7), (121.6, 58.2), (114.9, 117.4), (54.2, 110.1)])


def _image(corners: npt.NDArray[np.float64], blur_px: float = 0.8) -> npt.NDArray[np.uint8]:
    """A black square on white; each pixel is the mean of 8 x 8 places in it."""
    part = (np.arange(8) + 0.5) / 8 - 0.5
    y, x = np.meshgrid(
        (np.arange(160)[:, None] + part).ravel(), (np.arange(180)[:, None] + part).ravel(), indexing="ij"
    )
    inside = np.ones(x.shape, bool)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        inside &= (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0
    share = inside.reshape(160, 8, 180, 8).mean(axis=(1, 3))
    return np.asarray(cv2.GaussianBlur((220 - 200 * share).astype(np.uint8), (0, 0), blur_px), np.uint8)


def test_corners_that_are_a_pixel_off_are_put_right() -> None:
    rough = _SQUARE + np.random.default_rng(1).normal(0.0, 0.7, (4, 2))
    found = square_corners(_image(_SQUARE), rough, 8)
    assert found is not None
    np.testing.assert_allclose(found, _SQUARE, atol=0.05)


def test_where_an_edge_does_not_show_there_are_none() -> None:
    flat = np.full((160, 180), 128, np.uint8)
    assert square_corners(flat, _SQUARE, 8) is None
    assert square_corners(_image(_SQUARE), _SQUARE / 20, 8) is None, "a few pixels are no square"
    line = np.array([(60.0, 50.0), (120.0, 50.0), (121.0, 50.5), (61.0, 50.5)])
    assert square_corners(_image(_SQUARE), line, 8) is None
