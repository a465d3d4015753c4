"""Tags in one grey image, by OpenCV's detector, with what a judge wants to know and the detector does not tell.

The pose follows from the four corners by IPPE (Collins and Bartoli 2014), which gives both poses from which a square
looks nearly the same; each is then refined on the reprojection error. Its covariance is that of least squares:
sigma^2 (J' J)^-1 with J the corners' derivatives by rotation and translation. For the camera's process alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

from companion.camera.corners import square_corners
from companion.camera.sighting import MAX_TAGS, Tag
from companion.core.messages import Vector3

FAMILIES: Final = {"tag36h11": cv2.aruco.DICT_APRILTAG_36h11, "tag25h9": cv2.aruco.DICT_APRILTAG_25h9}
CORNER_PX: Final = 0.3
"""Deviation of a corner in each axis; docs/camera.md has what was measured."""
_CELL_PX: Final = 8
_INNER: Final = slice(2, 6)
"""Of a cell's pixels: its edges are blurred by its neighbours."""
_CORRECTED: Final = 1
"""Bits that the detector may correct; with more a picture of anything comes near to some code."""
_Floats = npt.NDArray[np.float64]


class TagDetector:
    """`sizes_m` are the sides of the black squares of the tags that are looked for, by their ids; of any other tag of
    the family `other_size_m` is taken. `matrix` (3, 3) and `distortion` (5,) are OpenCV's."""

    def __init__(
        self,
        *,
        family: str,
        sizes_m: Mapping[int, float],
        other_size_m: float,
        matrix: npt.ArrayLike,
        distortion: Sequence[float] = (),
    ) -> None:
        self._sizes_m = dict(sizes_m)
        self._other_m = other_size_m
        self._matrix = np.asarray(matrix, float)
        self._distortion = np.asarray(distortion, float)
        self._dictionary = cv2.aruco.getPredefinedDictionary(FAMILIES[family])
        self._side: Final = int(self._dictionary.markerSize)
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE  # companion.camera.corners does it
        parameters.errorCorrectionRate = (_CORRECTED + 0.5) / max(1, self._dictionary.maxCorrectionBits)
        self._detector = cv2.aruco.ArucoDetector(self._dictionary, parameters)

    def detect(self, grey: npt.NDArray[np.uint8]) -> list[Tag]:
        """Of an image (H, W), the clearest first."""
        found, ids, _ = self._detector.detectMarkers(grey)
        if ids is None:
            return []
        tags = [self._tag(grey, int(one), corners[0]) for one, corners in zip(ids.ravel(), found, strict=True)]
        return sorted((tag for tag in tags if tag is not None), key=lambda tag: -tag.margin)[:MAX_TAGS]

    def _tag(self, grey: npt.NDArray[np.uint8], number: int, found_px: npt.NDArray[np.float32]) -> Tag | None:
        """None where no pose fits the corners."""
        corners_px = square_corners(grey, found_px, self._side + 2)
        if corners_px is None:
            return None
        hamming, margin, contrast = self._read(grey, number, corners_px.astype(np.float32))
        half_m = self._sizes_m.get(number, self._other_m) / 2
        square_m = np.array([(-half_m, half_m, 0), (half_m, half_m, 0), (half_m, -half_m, 0), (-half_m, -half_m, 0)])
        try:
            poses = self._poses(square_m, corners_px)
        except cv2.error:
            return None
        if not poses:
            return None
        (error_px, rotation, place_m), (other_px, _, other_m) = poses[0], poses[-1]
        return Tag(
            id=number,
            hamming=hamming,
            margin=margin,
            contrast=contrast,
            p_camera_m=_vector(place_m),
            covariance_m2=self._covariance(square_m, rotation, place_m),
            error_px=error_px,
            other_p_camera_m=_vector(other_m),
            other_error_px=other_px,
        )

    def _poses(self, square_m: _Floats, corners_px: _Floats) -> list[tuple[float, _Floats, _Floats]]:
        """(root mean square error [px], rotation vector (3,), translation (3,)) of those before the camera, the best
        first."""
        count, turns, moves, _ = cv2.solvePnPGeneric(
            square_m, corners_px, self._matrix, self._distortion, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        poses: list[tuple[float, _Floats, _Floats]] = []
        for turn, move in zip(turns[:count], moves[:count], strict=True):
            turn, move = cv2.solvePnPRefineLM(square_m, corners_px, self._matrix, self._distortion, turn, move)
            shown, _ = cv2.projectPoints(square_m, turn, move, self._matrix, self._distortion)
            error_px = float(np.sqrt(np.mean(np.sum((shown[:, 0] - corners_px) ** 2, axis=1))))
            if move[2, 0] > 0 and math.isfinite(error_px):
                poses.append((error_px, np.ravel(turn).astype(float), np.ravel(move).astype(float)))
        return sorted(poses, key=lambda pose: pose[0])

    def _covariance(self, square_m: _Floats, turn: _Floats, move: _Floats) -> tuple[Vector3, Vector3, Vector3]:
        _, slopes = cv2.projectPoints(square_m, turn, move, self._matrix, self._distortion)
        j = slopes[:, :6]
        covariance = CORNER_PX**2 * np.linalg.pinv(j.T @ j)[3:, 3:]
        return _vector(covariance[0]), _vector(covariance[1]), _vector(covariance[2])

    def _read(
        self, grey: npt.NDArray[np.uint8], number: int, corners_px: npt.NDArray[np.float32]
    ) -> tuple[int, float, float]:
        """Bits that are wrong, the margin of the worst and the contrast, of the code as it stands in the image."""
        cells = self._side + 2
        side_px = cells * _CELL_PX
        square = np.array([(0, 0), (side_px, 0), (side_px, side_px), (0, side_px)], np.float32) - 0.5
        flat = cv2.warpPerspective(grey, cv2.getPerspectiveTransform(corners_px, square), (side_px, side_px))
        inner = flat.reshape(cells, _CELL_PX, cells, _CELL_PX)[:, _INNER, :, _INNER]
        brightness = inner.mean(axis=(1, 3))
        wanted = np.zeros((cells, cells), bool)
        wanted[1:-1, 1:-1] = self._bits(number)
        white, black = np.median(brightness[wanted]), np.median(brightness[~wanted])
        apart = float(white - black)
        if apart <= 0:
            return self._side**2, 0.0, 0.0
        told = np.where(wanted, 1, -1) * (brightness - (white + black) / 2) / (apart / 2)
        return int(np.count_nonzero(told <= 0)), float(max(0.0, told[told > 0].min(initial=1.0))), apart / 255

    def _bits(self, number: int) -> npt.NDArray[np.bool_]:
        """Of a code (side, side), True where it is white."""
        packed: Any = self._dictionary.bytesList[number : number + 1]
        return np.asarray(cv2.aruco.Dictionary.getBitsFromByteList(packed, self._side), bool)


def _vector(values: npt.NDArray[Any]) -> Vector3:
    x, y, z = np.ravel(values).tolist()
    return x, y, z
