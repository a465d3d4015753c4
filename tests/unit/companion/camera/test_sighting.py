"""What the camera's process tells, and what of it is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.camera.sighting import MAX_BYTES, MAX_TAGS, SightingError, TagFrame, decode, encode
from tests.unit.companion.camera.tags import TAG

_NEGATIVE = ((1e-4, 0.0, 0.0), (0.0, -1e-4, 0.0), (0.0, 0.0, 1e-4))
_ASKEW = ((1e-4, 1e-5, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-4))
_SURE_IN_TWO = ((1e-4, 1e-4, 0.0), (1e-4, 1e-4, 0.0), (0.0, 0.0, 0.0))
_FRAME = TagFrame(t_mono_ns=5, family="tag36h11", tags=(TAG,))


def test_a_frame_comes_out_as_it_went_in_and_a_full_one_fits() -> None:
    assert decode(encode(_FRAME)) == _FRAME
    full = replace(_FRAME, tags=(replace(TAG, p_camera_m=(math.pi, -math.pi, 1e-17)),) * MAX_TAGS)
    data = encode(full)
    sure = replace(_FRAME, tags=(replace(TAG, covariance_m2=_SURE_IN_TWO),))
    assert decode(encode(sure)) == sure
    assert decode(data) == full and len(data) < MAX_BYTES


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "truncated"),
        (b'{"t_mono_ns": 1}', "missing required field"),
        (b"[" * 5000, "expected `object`, got `array`"),
        (encode(replace(_FRAME, tags=(TAG,) * (MAX_TAGS + 1))), "17 tags in one image, expected 16 at most"),
        (encode(replace(_FRAME, t_mono_ns=-1)), "expected 0 or more"),
        (encode(replace(_FRAME, tags=(replace(TAG, p_camera_m=(0.0, 0.0, 2e3)),))), "farther than 1000 m"),
        (encode(replace(_FRAME, tags=(replace(TAG, covariance_m2=_NEGATIVE),))), "covariance that is negative"),
        (encode(replace(_FRAME, tags=(replace(TAG, covariance_m2=_ASKEW),))), "or not symmetric"),
        (encode(_FRAME).replace(b"0.8", b"1e999"), "finite|range"),
    ],
)
def test_what_is_no_frame_is_refused_in_words(data: bytes, words: str) -> None:
    with pytest.raises(SightingError, match=f"(?i){words}"):
        decode(data)
