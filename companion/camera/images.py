"""Where the camera's process has its images from: a camera by V4L2, a film, or a folder of pictures.

All give grey images with the time at which they were exposed, on CLOCK_MONOTONIC. For the camera's process alone.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt

_PICTURES: Final = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".pgm"})
_OLDEST_NS: Final = 1_000_000_000
"""A driver's time stamp that is older, or of the future, is of another clock."""
GreyImage = npt.NDArray[np.uint8]


class ImageError(Exception):
    """There are no images; the message says why, and what would be right."""


def images(source: str, rate_hz: float, size_px: tuple[int, int], delay_s: float) -> Iterator[tuple[int, GreyImage]]:
    """(time [ns], image (H, W)) of `source` (a path, or the number of a camera), at most `rate_hz` of them a second,
    until they end. `delay_s` is taken off the time of arrival where the driver tells none. Raises ImageError."""
    width, height = size_px
    for t_ns, image in _every(source, rate_hz, size_px, delay_s):
        if image.shape[:2] != (height, width):
            raise ImageError(
                f"{source}: images are {image.shape[1]} x {image.shape[0]} pixels; expected {width} x {height}, for "
                "which fx_px, fy_px, cx_px and cy_px hold (tag_camera.size_px)"
            )
        yield t_ns, image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def _every(source: str, rate_hz: float, size_px: tuple[int, int], delay_s: float) -> Iterator[tuple[int, Any]]:
    path = Path(source)
    if path.is_dir():
        return _folder(path, rate_hz)
    if path.is_file():
        return _film(path, rate_hz)
    if source.isdecimal() or path.is_char_device():
        return _camera(source, rate_hz, size_px, delay_s)
    raise ImageError(f"{source}: no such camera, film or folder")


def _camera(source: str, rate_hz: float, size_px: tuple[int, int], delay_s: float) -> Iterator[tuple[int, Any]]:
    """Every image is taken off the driver, so that none waits; what comes too early for the rate is not decoded."""
    camera = cv2.VideoCapture(int(source) if source.isdecimal() else source, cv2.CAP_V4L2)
    if not camera.isOpened():
        raise ImageError(f"{source}: cannot be opened as a camera; is it there, and in use by no other program?")
    try:
        for key, value in (
            (cv2.CAP_PROP_FRAME_WIDTH, size_px[0]),
            (cv2.CAP_PROP_FRAME_HEIGHT, size_px[1]),
            (cv2.CAP_PROP_BUFFERSIZE, 1),
        ):
            camera.set(key, value)
        due_ns = 0
        while camera.grab():
            arrived_ns = time.monotonic_ns()
            if arrived_ns < due_ns:
                continue
            due_ns = max(due_ns + round(1e9 / rate_hz), arrived_ns)
            told_ns = round(camera.get(cv2.CAP_PROP_POS_MSEC) * 1e6)  # V4L2's buffer time, where it is monotonic
            is_told = 0 <= arrived_ns - told_ns < _OLDEST_NS
            read, image = camera.retrieve()
            if read:
                yield (told_ns if is_told else arrived_ns - round(delay_s * 1e9)), image
    finally:
        camera.release()
    raise ImageError(f"{source}: gives no more images; was it unplugged?")


def _film(path: Path, rate_hz: float) -> Iterator[tuple[int, Any]]:
    film = cv2.VideoCapture(str(path))
    if not film.isOpened():
        raise ImageError(f"{path}: not a film that OpenCV reads")
    try:
        for t_ns in _times(rate_hz):
            read, image = film.read()
            if not read:
                return
            yield t_ns, image
    finally:
        film.release()


def _folder(folder: Path, rate_hz: float) -> Iterator[tuple[int, Any]]:
    """In the order of their names, numbers counted as numbers."""
    pictures = sorted((path for path in folder.iterdir() if path.suffix.lower() in _PICTURES), key=_in_order)
    if not pictures:
        raise ImageError(f"{folder}: holds no picture; expected files that end in {', '.join(sorted(_PICTURES))}")
    for t_ns, path in zip(_times(rate_hz), pictures, strict=False):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise ImageError(f"{path}: not a picture that OpenCV reads")
        yield t_ns, image


def _in_order(path: Path) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name)]


def _times(rate_hz: float) -> Iterator[int]:
    next_ns = time.monotonic_ns()
    while True:
        time.sleep(max(0, next_ns - time.monotonic_ns()) / 1e9)
        yield time.monotonic_ns()
        next_ns += round(1e9 / rate_hz)
