"""What of two decisions counts as a difference, and what another processor's rounding may do."""

from __future__ import annotations

from typing import Any

import pytest

from companion.replay.check import differences

ANGLES: list[list[Any]] = [[4e-4, 1e-5, 0.0], [1e-5, 4e-4, 0.0], [0.0, 0.0, None]]
RANGED: list[list[Any]] = [[4e-4, 1e-5, 5e-3], [1e-5, 4e-4, -5e-3], [5e-3, -5e-3, 90.0]]


def changed(rows: list[list[Any]], i: int, j: int, value: float | None) -> list[list[Any]]:
    copy = [list(row) for row in rows]
    copy[i][j] = value
    return copy


@pytest.mark.parametrize(
    "theirs",
    [
        RANGED,
        changed(RANGED, 2, 2, 94.0),  # the range is known to 9.5 m, or to 9.7
        changed(RANGED, 0, 2, 5.2e-3),
        changed(RANGED, 0, 1, 1.2e-5),  # of deviations of 0.02 rad that is nothing
    ],
)
def test_covariances_may_round_by_a_share_of_the_deviations(theirs: list[list[Any]]) -> None:
    assert list(differences("estimate", {"covariance": RANGED}, {"covariance": theirs})) == []


@pytest.mark.parametrize(
    ("theirs", "named"),
    [
        (changed(RANGED, 0, 0, 4.1e-4), "[0][0]"),
        (changed(RANGED, 2, 2, 120.0), "[2][2]"),
        (changed(RANGED, 0, 1, 1e-4), "[0][1]"),
        (changed(RANGED, 2, 2, None), "[2][2]"),
        ([[4e-4, 0.0], [0.0, 4e-4]], "(3, 3)"),
    ],
)
def test_another_covariance_is_named(theirs: list[list[Any]], named: str) -> None:
    found = list(differences("estimate", {"covariance": RANGED}, {"covariance": theirs}))
    assert found and all(text.startswith("estimate.covariance") for text in found)
    assert any(named in text for text in found)


def test_a_range_that_both_do_not_have_is_no_difference() -> None:
    assert list(differences("", {"covariance": ANGLES}, {"covariance": ANGLES})) == []
    assert list(differences("", {"covariance": ANGLES}, {"covariance": changed(ANGLES, 0, 0, 9e-4)}))
    assert list(differences("", {"covariance": ANGLES}, {"covariance": None}))
    unranged = {"range_m": None, "range_std_m": 9.7, "covariance": RANGED}
    other = {"range_m": None, "range_std_m": 6.3, "covariance": changed(RANGED, 2, 2, 39.4)}
    assert list(differences("", unranged, other)) == []
    assert list(differences("", unranged | {"range_m": 12.0}, other | {"range_m": 12.0}))


@pytest.mark.parametrize(
    ("name", "ours", "theirs", "same"),
    [
        ("azimuth_rad", 3.1413, -3.1413, True),
        ("azimuth_rad", 1.0, 1.002, False),
        ("range_m", 10.0, 10.09, True),
        ("range_m", 10.0, 10.2, False),
        ("range_std_m", 9.5, 9.2, True),
        ("range_std_m", 9.5, 5.0, False),
        ("drift_turns", 0.171, 0.177, True),
        ("drift_turns", 0.171, 0.190, False),
        ("phase_variance_rad2", 0.69, 0.74, True),
        ("phase_variance_rad2", 0.69, 0.80, False),
        ("reliability", 0.9, 0.905, True),
        ("reliability", 0.9, 0.92, False),
        ("height_m", 3.0, 3.015, True),
        ("height_m", 3.0, 3.03, False),
        ("probability", 0.11, 0.119, True),
        ("probability", 0.11, 0.13, False),
        ("direction_90_rad", 0.2, 0.205, True),
        ("direction_90_rad", 0.2, 0.21, False),
        ("p_local_enu_m", 5.0, 5.015, True),
        ("p_local_enu_m", 5.0, 5.03, False),
        ("t_ns", 5, 6, False),
        ("state", "idle", "latched", False),
    ],
)
def test_tolerances_follow_the_unit(name: str, ours: Any, theirs: Any, same: bool) -> None:
    assert (list(differences("", {name: ours}, {name: theirs})) == []) is same


def test_covariances_of_a_place_may_round_by_a_share_of_both_deviations() -> None:
    place = [[9.0, 0.05, 0.0], [0.05, 4.0, 0.1], [0.0, 0.1, 1.0]]
    rounded = [[9.05, 0.06, 0.0], [0.06, 4.03, 0.1], [0.0, 0.1, 1.0]]
    assert list(differences("target", {"covariance_m2": place}, {"covariance_m2": rounded})) == []
    rounded[0][1] = 0.3
    assert list(differences("target", {"covariance_m2": place}, {"covariance_m2": rounded})) == [
        "target.covariance_m2[0][1] was 0.05, is 0.3"
    ]


def test_places_of_a_target_may_round_by_a_share_of_its_deviation() -> None:
    ours = {"p_local_enu_m": [5.0, 0.0, 0.0], "rivals": [{"origin_local_enu_m": [9.0, 1.0, 0.0], "height_m": 1.0}]}
    theirs = {"p_local_enu_m": [5.08, 0.0, 0.0], "rivals": [{"origin_local_enu_m": [9.0, 1.08, 0.0], "height_m": 1.0}]}
    assert list(differences("", ours, theirs, place_m=0.1)) == []
    assert len(list(differences("", ours, theirs))) == 2
    theirs["rivals"][0]["height_m"] = 1.08  # type: ignore[index]
    assert list(differences("", ours, theirs, place_m=0.1)) == ["rivals[0].height_m was 1.0, is 1.08"]
