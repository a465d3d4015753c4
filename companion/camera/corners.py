"""Corners of a black square in an image, from its whole edges instead of from what stands around each corner.

Along each edge the step from black to white is looked for on lines across it, at the centroid of the squared gradient;
a line is fitted to these places and neighbouring lines are cut. So the inner cells, which pull a corner that is refined
by its own neighbourhood, have no say, and the noise is that of many pixels (as Olson 2011 and Wang 2016 do).
"""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

_ALONG: Final = np.linspace(0.08, 0.92, 32)
"""Of an edge: near its ends there is no edge on one side."""
_STEP_PX: Final = 0.25
_MOST_PX: Final = 2.5
_OF_CELL: Final = 0.8
"""How far across the edge is looked, of a cell: black within and white without are one cell wide at least."""
_ROUNDS: Final = 2
_LEAST_SHARE: Final = 0.5
"""Of the places along an edge at which a step must show."""
_BOTH: Any = None
"""The first map holds both coordinates; OpenCV's types do not know of it."""
_Floats = npt.NDArray[np.float64]


def square_corners(grey: npt.NDArray[np.uint8], corners_px: npt.ArrayLike, cells: int) -> _Floats | None:
    """(4, 2) from (4, 2) [px], in their order, clockwise in the image; None where an edge does not show. The square is
    `cells` wide. Pixel (0, 0) has its centre at 0, 0."""
    corners = np.asarray(corners_px, float)
    for _ in range(_ROUNDS):
        ends = np.roll(corners, -1, axis=0)
        along = ends - corners
        length = np.linalg.norm(along, axis=1, keepdims=True)
        reach_px = min(_MOST_PX, _OF_CELL * float(length.min()) / cells)
        if reach_px < 2 * _STEP_PX:
            return None
        outwards = np.column_stack([along[:, 1], -along[:, 0]]) / length
        points = corners[:, None] + _ALONG[:, None] * along[:, None]  # (4, along, 2)
        steps = _steps(grey, points, outwards, reach_px)
        if np.any(np.count_nonzero(np.isfinite(steps), axis=1) < _LEAST_SHARE * len(_ALONG)):
            return None
        lines = [
            _line(points[edge][known] + steps[edge][known][:, None] * outwards[edge])
            for edge, known in enumerate(np.isfinite(steps))
        ]
        cut = [_crossing(lines[edge - 1], lines[edge]) for edge in range(4)]
        if any(one is None for one in cut):
            return None
        corners = np.array(cut)
    return corners


def _steps(grey: npt.NDArray[np.uint8], points: _Floats, outwards: _Floats, reach_px: float) -> _Floats:
    """How far outside its edge each place (4, N, 2) has its step from black to white [px], (4, N); NaN without one."""
    offsets = np.arange(-reach_px - 0.5, reach_px + 0.5 + _STEP_PX / 2, _STEP_PX)
    places = (points[:, :, None] + offsets[:, None] * outwards[:, None, None]).astype(np.float32)
    flat = places.reshape(4 * points.shape[1], len(offsets), 2)
    seen = cv2.remap(grey.astype(np.float32), flat, _BOTH, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    apart = round(0.5 / _STEP_PX)
    rise = np.maximum(0.0, seen[:, 2 * apart :] - seen[:, : -2 * apart])
    weight = rise.astype(float) ** 2
    total = weight.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        at = np.where(total > 1.0, weight @ offsets[apart:-apart] / total, np.nan)
    return np.asarray(at.reshape(points.shape[:2]))


def _line(points: _Floats) -> tuple[_Floats, _Floats]:
    """A place on the line (2,) and its direction (2,)."""
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    return middle, axes[0]


def _crossing(one: tuple[_Floats, _Floats], other: tuple[_Floats, _Floats]) -> _Floats | None:
    sides = np.column_stack([one[1], -other[1]])
    if abs(np.linalg.det(sides)) < 0.05:  # nearly parallel
        return None
    return np.asarray(one[0] + np.linalg.solve(sides, other[0] - one[0])[0] * one[1])
