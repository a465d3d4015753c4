from __future__ import annotations

import pytest

from companion.autopilot.kind import drives, kind_of


@pytest.mark.parametrize(
    ("autopilot", "vehicle", "kind", "on_wheels"),
    [
        (12, 2, "px4", False),
        (12, 10, "px4 on a ground rover", True),
        (3, 22, "ardupilot on a VTOL", False),
        (8, 5, "autopilot 8 on a vehicle of MAV_TYPE 5", False),
    ],
)
def test_an_autopilot_is_named_with_what_it_steers(autopilot: int, vehicle: int, kind: str, on_wheels: bool) -> None:
    assert kind_of(autopilot, vehicle) == kind and drives(kind) is on_wheels
