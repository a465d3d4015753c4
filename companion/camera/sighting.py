"""What the camera's process tells of one image: the tags in it, each with its place in the camera's axes.

Camera axes: x to the right of the image, y down it, z along the optical axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import msgspec
import numpy as np

from companion.core.messages import Vector3

Matrix = tuple[Vector3, Vector3, Vector3]
MAX_BYTES: Final = 16384
MAX_TAGS: Final = 16
"""In one image; more are noise, and the likeliest are told."""
_MOST_M: Final = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Tag:
    """One tag in one image."""

    id: int
    hamming: int
    """Bits of its code that were read wrongly."""
    margin: float
    """Of the bit that was told worst: how far its brightness is from the threshold, as a share of the contrast between
    black and white of this tag (0 nothing, 1 all). Blur and glare take it away first."""
    contrast: float
    """Between its black and its white, of the largest that an image holds (0..1)."""
    p_camera_m: Vector3
    """Its centre."""
    covariance_m2: Matrix
    """Of that, by the noise of the corners alone."""
    error_px: float
    """Root mean square distance of its corners from where that pose puts them."""
    other_p_camera_m: Vector3
    """Its centre in the second pose from which a square looks nearly the same."""
    other_error_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TagFrame:
    """One image, whether there was a tag in it or not. The time is CLOCK_MONOTONIC of this host when it was exposed."""

    t_mono_ns: int
    family: str
    tags: tuple[Tag, ...]


class SightingError(ValueError):
    """Bytes are no frame of the camera's process; the message says in which way."""


def encode(frame: TagFrame) -> bytes:
    return msgspec.json.encode(frame)


def decode(data: bytes) -> TagFrame:
    """Raises SightingError for anything that `encode` did not make of a frame that can be."""
    try:
        frame = _DECODER.decode(data)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise SightingError(str(error)) from None
    if len(frame.tags) > MAX_TAGS:
        raise SightingError(f"{len(frame.tags)} tags in one image, expected {MAX_TAGS} at most")
    if frame.t_mono_ns < 0:
        raise SightingError(f"time {frame.t_mono_ns}, expected 0 or more")
    for tag in frame.tags:
        numbers = (*tag.p_camera_m, *tag.other_p_camera_m, *(value for row in tag.covariance_m2 for value in row))
        if not _are_sane((*numbers, tag.margin, tag.contrast, tag.error_px, tag.other_error_px)):
            raise SightingError(f"tag {tag.id} is not finite, or farther than {_MOST_M:g} m")
        if not _may_be_covariance(tag.covariance_m2):
            raise SightingError(f"tag {tag.id} has a covariance that is negative, or not symmetric")
    return frame


def _are_sane(numbers: Iterable[float]) -> bool:
    return all(math.isfinite(number) and abs(number) < _MOST_M for number in numbers)


def _may_be_covariance(matrix_m2: Matrix) -> bool:
    """But for what rounding does: what is sure in some direction has no variance there."""
    matrix = np.array(matrix_m2)
    rounding = 1e-9 * max(1e-6, float(np.abs(matrix).max()))
    return bool(np.abs(matrix - matrix.T).max() <= rounding and np.linalg.eigvalsh(matrix)[0] >= -rounding)


_DECODER: Final = msgspec.json.Decoder(TagFrame)
