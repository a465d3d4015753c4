"""Images of a tag as a camera would see it: by a homography, with what a lens, the sun and a sensor make of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

WIDTH: Final = 640
HEIGHT: Final = 480
FOCAL_PX: Final = 600.0
MATRIX: Final = np.array([[FOCAL_PX, 0.0, WIDTH / 2], [0.0, FOCAL_PX, HEIGHT / 2], [0.0, 0.0, 1.0]])
SIZE_M: Final = 0.16
_CELL_PX: Final = 40
_QUIET: Final = 2
"""Cells of white around the black square."""
_BEHIND: Final = 90
_OVER: Final = 4
"""Pixels are integrated over so many in each axis."""
_Image = npt.NDArray[np.uint8]
_Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """How a tag stands before the camera and what spoils its image."""

    distance_m: float
    tilt_rad: float = 0.0
    """Between its normal and the line to it,"""
    turn_rad: float = 0.0
    """about an axis that is turned by this in the image."""
    roll_rad: float = 0.0
    aside: tuple[float, float] = (0.0, 0.0)
    """Of the image's half width and half height from its middle."""
    blur_px: float = 0.6
    """Deviation of a lens' blur,"""
    motion_px: float = 0.0
    """and length of a movement's, across."""
    noise: float = 3.0
    """Deviation of brightness, of 255."""
    glare: float = 0.0
    """Radius of a saturated patch, in sides of the tag, off the tag's centre by half a side."""
    covered: float = 0.0
    """Share of the tag's side that something grey stands before."""
    light: float = 1.0


def tag_place(view: View) -> _Floats:
    """Centre of the tag in camera axes (3,)."""
    ray = np.array([view.aside[0] * WIDTH / 2 / FOCAL_PX, view.aside[1] * HEIGHT / 2 / FOCAL_PX, 1.0])
    return view.distance_m * ray / np.linalg.norm(ray)


def tag_image(view: View, number: int, rng: np.random.Generator, family: int = cv2.aruco.DICT_APRILTAG_36h11) -> _Image:
    """(HEIGHT, WIDTH), grey."""
    dictionary = cv2.aruco.getPredefinedDictionary(family)
    cells = dictionary.markerSize + 2
    pattern = cv2.aruco.generateImageMarker(dictionary, number, cells * _CELL_PX)
    quiet_px = _QUIET * _CELL_PX
    pattern = cv2.copyMakeBorder(pattern, *(quiet_px,) * 4, cv2.BORDER_CONSTANT, value=235)
    pattern = np.clip(pattern, 20, 235)
    if view.covered:
        wide_px = round(view.covered * cells * _CELL_PX)
        pattern[:, quiet_px : quiet_px + wide_px] = 128
    to_image = _homography(view, cells)
    left, top, right, bottom = _box(to_image, pattern.shape[0])
    scale = np.diag([_OVER, _OVER, 1.0])
    scale[:2, 2] = (_OVER - 1) / 2 - _OVER * left, (_OVER - 1) / 2 - _OVER * top
    size = ((right - left) * _OVER, (bottom - top) * _OVER)
    shape = cv2.warpPerspective(np.full_like(pattern, 255), scale @ to_image, size)
    shown = cv2.warpPerspective(pattern, scale @ to_image, size, flags=cv2.INTER_AREA)
    large = np.where(shape > 127, shown, np.full_like(shown, _BEHIND))
    image: Any = np.full((HEIGHT, WIDTH), _BEHIND, np.float32)
    image[top:bottom, left:right] = cv2.resize(large, (right - left, bottom - top), interpolation=cv2.INTER_AREA)
    image *= view.light
    if view.glare:
        image = np.maximum(image, _glare(view))
    if view.blur_px:
        image = cv2.GaussianBlur(image, (0, 0), view.blur_px)
    if view.motion_px >= 1:
        length = round(view.motion_px)
        image = cv2.blur(image, (length, 1))
    image += rng.normal(0.0, view.noise, image.shape).astype(np.float32)
    return np.asarray(np.clip(image, 0, 255).astype(np.uint8))


def empty_image(rng: np.random.Generator) -> _Image:
    """Clutter without a tag: rectangles of all sizes and brightnesses, one upon the other."""
    image = np.full((HEIGHT, WIDTH), 100, np.uint8)
    for _ in range(120):
        corner = (int(rng.integers(WIDTH)), int(rng.integers(HEIGHT)))
        size = (float(rng.integers(6, 150)), float(rng.integers(6, 150)))
        box = cv2.boxPoints((corner, size, float(rng.uniform(0, 90)))).astype(np.int32)
        cv2.fillPoly(image, [box], int(rng.integers(256)))
    grid = rng.integers(0, 2, (16, 16)).astype(np.uint8) * 255
    image[40:232, 40:232] = cv2.resize(grid, (192, 192), interpolation=cv2.INTER_NEAREST)
    return np.clip(image + rng.normal(0.0, 3.0, image.shape), 0, 255).astype(np.uint8)


def _box(to_image: _Floats, side_px: int) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of the pixels a pattern falls on."""
    corners = to_image @ np.array([(0, 0, 1), (side_px, 0, 1), (side_px, side_px, 1), (0, side_px, 1)]).T
    at = corners[:2] / corners[2]
    low, high = np.floor(at.min(axis=1)) - 1, np.ceil(at.max(axis=1)) + 2
    left, top = np.clip(low, 0, (WIDTH - 1, HEIGHT - 1)).astype(int).tolist()
    right, bottom = np.clip(high, (left + 1, top + 1), (WIDTH, HEIGHT)).astype(int).tolist()
    return left, top, right, bottom


def _homography(view: View, cells: int) -> _Floats:
    """From the pattern's pixels to the image's."""
    axis = np.array([math.cos(view.turn_rad), math.sin(view.turn_rad), 0.0])
    tilt, _ = cv2.Rodrigues(axis * view.tilt_rad)
    roll, _ = cv2.Rodrigues(np.array([0.0, 0.0, view.roll_rad]))
    place_m = tag_place(view)
    facing = _facing(place_m)
    turned = facing @ tilt @ roll
    metres = SIZE_M / (cells * _CELL_PX)
    middle = (cells + 2 * _QUIET) * _CELL_PX / 2 - 0.5
    plane = np.array([[metres, 0.0, -metres * middle], [0.0, metres, -metres * middle], [0.0, 0.0, 1.0]])
    return np.asarray(MATRIX @ np.column_stack([turned[:, 0], turned[:, 1], place_m]) @ plane)


def _facing(place_m: _Floats) -> _Floats:
    """The rotation that turns the optical axis to a place."""
    z = place_m / np.linalg.norm(place_m)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _glare(view: View) -> npt.NDArray[np.float32]:
    place_m = tag_place(view)
    side_px = FOCAL_PX * SIZE_M / view.distance_m
    centre = MATRIX[:2] @ (place_m / place_m[2]) + 0.5 * side_px * np.array([0.6, -0.8])
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    away = np.hypot(x - centre[0], y - centre[1]) / (view.glare * side_px)
    return np.asarray(420.0 * np.exp(-(away**4)), np.float32)
