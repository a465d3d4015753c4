"""Tags in rendered images: found where they are, read as they are, doubted where the image is spoilt."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("cv2", reason="needs the extra apriltag")

from benchmarks.tag_images import MATRIX, SIZE_M, View, empty_image, tag_image, tag_place
from benchmarks.tags import OURS, detector, squared_error
from companion.camera.detector import TagDetector
from companion.guidance.camera_target import AGREES, doubt

_VIEWS = [
    View(distance_m=0.6, tilt_rad=0.2),
    View(distance_m=2.0, tilt_rad=math.radians(60), turn_rad=1.0, roll_rad=2.0, aside=(0.4, -0.3)),
    View(distance_m=4.0, tilt_rad=math.radians(30), turn_rad=2.5, roll_rad=4.0, aside=(-0.4, 0.2)),
]


@pytest.mark.parametrize("view", _VIEWS, ids=lambda view: f"{view.distance_m:g} m")
def test_a_tag_is_found_where_it_stands(view: View) -> None:
    (tag,) = detector().detect(tag_image(view, OURS, np.random.default_rng(1)))
    assert (tag.id, tag.hamming, doubt(tag, 8.0)) == (OURS, 0, None)
    off_m = float(np.linalg.norm(np.array(tag.p_camera_m) - tag_place(view)))
    assert off_m < 0.005 * view.distance_m and squared_error(tag, view) < AGREES
    assert tag.other_error_px >= tag.error_px and tag.contrast > 0.5


def test_a_lens_that_bends_is_allowed_for() -> None:
    """A distortion that moves the corners moves the place where it is not configured, and is taken back where it is."""
    view = View(distance_m=1.0, aside=(0.5, 0.5))
    image = tag_image(view, OURS, np.random.default_rng(1))
    bent = TagDetector(
        family="tag36h11",
        sizes_m={OURS: SIZE_M},
        other_size_m=SIZE_M,
        matrix=MATRIX,
        distortion=(0.3, 0.0, 0.0, 0.0, 0.0),
    )
    straight = detector()
    places = [np.array(one.detect(image)[0].p_camera_m) for one in (straight, bent)]
    assert np.linalg.norm(places[0] - tag_place(view)) < 0.01 < np.linalg.norm(places[1] - places[0])


@pytest.mark.parametrize("number", [0, 8, 586])
def test_another_tag_is_never_ours(number: int) -> None:
    rng = np.random.default_rng(number)
    for blur_px in (0.6, 1.5):
        found = detector().detect(tag_image(replace(_VIEWS[1], blur_px=blur_px), number, rng))
        assert {tag.id for tag in found} <= {number}


def test_what_is_no_tag_is_none() -> None:
    rng = np.random.default_rng(3)
    assert [tag.id for _ in range(4) for tag in detector().detect(empty_image(rng)) if doubt(tag, 8.0) is None] == []
    assert detector().detect(np.full((480, 640), 255, np.uint8)) == []


@pytest.mark.parametrize(
    "spoilt",
    [
        {"glare": 0.7},
        {"blur_px": 3.0},
        {"motion_px": 12.0},
        {"covered": 0.4},
        {"light": 0.05, "noise": 8.0},
    ],
    ids=["glare", "blur", "motion", "covered", "dark"],
)
def test_a_spoilt_image_gives_nothing_that_is_believed(spoilt: dict[str, float]) -> None:
    rng = np.random.default_rng(4)
    for distance_m in (3.0, 3.5):
        view = replace(View(distance_m=distance_m, tilt_rad=0.5, turn_rad=1.0), **spoilt)  # type: ignore[arg-type]
        found = detector().detect(tag_image(view, OURS, rng))
        assert [tag for tag in found if doubt(tag, 8.0) is None] == []


def test_a_little_of_it_widens_the_place_or_is_doubted() -> None:
    rng = np.random.default_rng(5)
    told = 0
    for spoilt in ({"glare": 0.3}, {"blur_px": 1.2}, {"motion_px": 4.0}, {"covered": 0.05}):
        view = replace(View(distance_m=1.5, tilt_rad=0.5, turn_rad=1.0), **spoilt)  # type: ignore[arg-type]
        for tag in detector().detect(tag_image(view, OURS, rng)):
            told += 1
            assert doubt(tag, 8.0) is not None or squared_error(tag, view) < AGREES
    assert told >= 2
