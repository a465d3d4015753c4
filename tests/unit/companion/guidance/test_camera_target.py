"""Which sightings are believed, when the camera leads, and when it no longer does."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from companion.camera.place import TagPlace
from companion.core.clock import NS_PER_S
from companion.core.messages import Vector3
from companion.guidance.camera_target import CameraTargets, Doubt, doubt
from companion.guidance.target import Target, WholeBelief
from tests.unit.companion.camera.tags import TAG

_PEER, _BOOT = 2, 11
_THERE = np.array([5.0, 1.0, 0.5])
_ROBOT: Vector3 = (2.0, 0.0, 0.0)
"""Where the robot is by its own poses: their origin is at 3, 1, 0.5."""
_CORNERS = np.eye(3) * 0.02**2
_SHARED = np.eye(3) * 0.08**2


def _radio(origin_m: Vector3, std_m: float = 1.0, boot: int = _BOOT) -> Target:
    covariance = ((std_m**2, 0.0, 0.0), (0.0, std_m**2, 0.0), (0.0, 0.0, std_m**2))
    whole = WholeBelief(
        origin_local_enu_m=origin_m, covariance_m2=covariance, range_90_m=(1.0, 9.0), direction_90_rad=0.3
    )
    return Target(
        t_mono_ns=0, azimuth_rad=0.0, origin_local_enu_m=origin_m, covariance_m2=covariance, boot=boot, range_m=5.0,
        range_std_m=std_m, probability=0.8, whole=whole,
    )  # fmt: skip


_AGREES = _radio((3.5, 1.0, 0.5))
_DISAGREES = _radio((-10.0, 1.0, 0.5))


class _Seen:
    """Ten sightings a second from a place of ours that moves."""

    def __init__(self) -> None:
        self.targets = CameraTargets()
        self.t_ns = 50 * NS_PER_S
        self.own_m = np.zeros(3)
        self.doubts: list[Doubt | None] = []

    def see(
        self,
        count: int = 1,
        at_m: npt.NDArray[np.float64] = _THERE,
        radio: Target | None = None,
        step_m: float = 0.0,
        boot: int = _BOOT,
    ) -> None:
        for _ in range(count):
            self.t_ns += NS_PER_S // 10
            self.own_m = self.own_m + np.array([step_m, 0.0, 0.0])
            place = TagPlace(at_m, _CORNERS + _SHARED, _CORNERS)
            x, y, z = self.own_m.tolist()
            self.doubts.append(self.targets.add(_PEER, self.t_ns, place, (x, y, z), robot=(boot, _ROBOT), radio=radio))

    @property
    def leads(self) -> bool:
        return self.targets.place(_PEER, self.t_ns) is not None


@pytest.mark.parametrize(
    ("tag", "why"),
    [
        (TAG, None),
        (replace(TAG, hamming=1), None),
        (replace(TAG, hamming=2), Doubt.BITS),
        (replace(TAG, margin=0.2), Doubt.BITS),
        (replace(TAG, contrast=0.05), Doubt.BITS),
        (replace(TAG, error_px=0.6), Doubt.EDGES),
        (replace(TAG, p_camera_m=(6.0, 0.0, 6.0)), Doubt.RANGE),
    ],
)
def test_an_image_alone_may_make_a_sighting_doubtful(tag: object, why: Doubt | None) -> None:
    assert doubt(tag, 8.0) is why  # type: ignore[arg-type]


def test_three_sightings_that_agree_with_the_radio_lead() -> None:
    seen = _Seen()
    seen.see(2, radio=_AGREES)
    assert not seen.leads
    seen.see(radio=_AGREES)
    place = seen.targets.place(_PEER, seen.t_ns)
    assert place is not None and place.boot == _BOOT
    np.testing.assert_allclose(place.origin_local_enu_m, _THERE - _ROBOT, atol=1e-9)
    assert place.place(_ROBOT) == pytest.approx(tuple(_THERE))
    std_m = math.sqrt(place.covariance_m2[0][0])
    assert 0.08 < std_m < math.hypot(0.02, 0.08), "what is the same in all images is not averaged away"


@pytest.mark.parametrize("radio", [None, _DISAGREES, _radio((3.5, 1.0, 0.5), boot=12)])
def test_against_the_radio_it_must_be_seen_from_places_that_differ(radio: Target | None) -> None:
    seen = _Seen()
    seen.see(29, radio=radio)
    assert not seen.leads, "a hover proves nothing"
    seen.see(6, radio=radio, step_m=0.08)
    assert not seen.leads
    seen.see(2, radio=radio, step_m=0.08)
    assert seen.leads


def test_what_is_elsewhere_than_before_is_not_believed_and_begins_anew_when_it_stays() -> None:
    seen = _Seen()
    seen.see(5, radio=_AGREES)
    seen.see(4, at_m=_THERE + 2.0, radio=_AGREES)
    assert seen.doubts == [None] * 5 + [Doubt.TRACK] * 4 and seen.leads
    seen.see(2, at_m=_THERE + 2.0, radio=_DISAGREES)
    assert not seen.leads, "the track before is old by now"
    assert seen.doubts[-1] is None


def test_it_leads_for_half_a_second_after_the_last_and_must_be_confirmed_anew() -> None:
    seen = _Seen()
    seen.see(3, radio=_AGREES)
    assert seen.targets.place(_PEER, seen.t_ns + NS_PER_S // 2) is not None
    assert seen.targets.place(_PEER, seen.t_ns + NS_PER_S // 2 + 1) is None
    seen.t_ns += NS_PER_S
    seen.see(1, radio=_AGREES)
    assert not seen.leads
    assert seen.targets.place(3, seen.t_ns) is None


def test_another_boot_of_the_robot_has_another_origin() -> None:
    seen = _Seen()
    seen.see(3, radio=_AGREES)
    seen.see(1, radio=_AGREES, boot=_BOOT + 1)
    assert not seen.leads


def test_a_frame_that_was_set_anew_moves_what_was_seen_along() -> None:
    seen = _Seen()
    seen.see(3, radio=_AGREES)
    seen.targets.shift((1.0, -2.0, 0.5))
    place = seen.targets.place(_PEER, seen.t_ns)
    assert place is not None
    np.testing.assert_allclose(place.origin_local_enu_m, _THERE - _ROBOT + (1.0, -2.0, 0.5))
    seen.targets.forget()
    assert not seen.leads


def test_the_probability_of_being_near_follows_from_distance_and_deviation() -> None:
    seen = _Seen()
    seen.see(3, radio=_AGREES)
    place = seen.targets.place(_PEER, seen.t_ns)
    assert place is not None
    here: Vector3 = (3.0, 1.0, 0.5)
    assert place.within(here, _ROBOT, 2.0) == pytest.approx(0.5)
    assert place.within(here, _ROBOT, 2.2) > 0.98 and place.within(here, _ROBOT, 1.8) < 0.02
    assert place.within((5.0, 1.0, 0.5), _ROBOT, 2.0) == pytest.approx(1.0)
