"""Where PX4 1.16.1's own modes begin and end: takeoff, return, fence."""

from __future__ import annotations

import pytest

from companion.sim.px4.commander import Mode
from tests.unit.companion.sim.px4.client import HOLD, LAND, Client

_RTL = (4, 5)


@pytest.mark.parametrize(("height_m", "ends_m"), [(1.5, 0.7), (2.7, 1.9), (5.0, 4.2)])
def test_takeoff_ends_below_its_height_and_hold_climbs_the_rest(height_m: float, ends_m: float) -> None:
    client = Client(parameters={"MIS_TAKEOFF_ALT": height_m})
    client.command(400, 1)
    client.command(22)
    while client.mode() is Mode.TAKEOFF:
        client.run(0.02)
    assert client.mode() is Mode.HOLD
    assert client.px4.commander.airframe.p_enu_m[2] == pytest.approx(ends_m, abs=0.05)
    client.run(6)
    assert client.px4.commander.airframe.p_enu_m[2] == pytest.approx(height_m, abs=0.05)


def test_hold_that_a_person_takes_on_the_way_up_stays_there() -> None:
    client = Client(parameters={"MIS_TAKEOFF_ALT": 5.0})
    client.command(400, 1)
    client.command(22)
    client.run(1.5)
    client.order("pilot HOLD")
    client.run(6)
    assert client.px4.commander.airframe.p_enu_m[2] < 3.0


def _out(client: Client, north_m: float) -> Client:
    client.take_off()
    client.go_offboard()
    client.run(4 + north_m / 2, stream_hz=20, point=(north_m, 0, -2, 0, 0, 0, 0))
    client.set_mode(HOLD)
    return client


@pytest.mark.parametrize(("north_m", "highest_m"), [(1.0, 2.0), (6.0, 6.0), (15.0, 30.0)])
def test_return_climbs_first(north_m: float, highest_m: float) -> None:
    """To RTL_RETURN_ALT, or nearer than 10 m to the cone of 45 degrees, before it comes home and lands."""
    client = _out(Client(parameters={"MIS_TAKEOFF_ALT": 2.0}), north_m)
    assert client.set_mode(_RTL) == [0, 0]
    highest_seen_m, left_at_m = 0.0, None
    for _ in range(100):
        client.run(0.5)
        _, north, up = client.px4.commander.airframe.p_enu_m
        highest_seen_m = max(highest_seen_m, up)
        if left_at_m is None and north < 0.9 * north_m:
            left_at_m = up
    assert highest_seen_m == pytest.approx(highest_m, abs=0.3)
    assert left_at_m is not None and left_at_m > highest_m - 1.0
    client.run(40)
    assert not client.px4.commander.armed
    assert client.px4.commander.airframe.p_enu_m[1] == pytest.approx(0.0, abs=0.5)


def test_return_through_the_fences_ceiling_ends_in_a_hold_that_nobody_lands() -> None:
    client = _out(Client(parameters={"MIS_TAKEOFF_ALT": 2.0, "GF_MAX_VER_DIST": 12.0, "GF_ACTION": 2}), 15.0)
    client.set_mode(_RTL)
    client.run(60)
    assert client.mode() is Mode.HOLD and client.px4.commander.failsafe
    assert client.px4.commander.airframe.p_enu_m[2] == pytest.approx(12.8, abs=1.0)
    assert client.set_mode(LAND) == [0, 0] and client.mode() is Mode.LAND


def test_a_requested_mode_overrides_the_fence() -> None:
    client = Client(parameters={"MIS_TAKEOFF_ALT": 2.0, "GF_MAX_HOR_DIST": 4.0})
    client.take_off()
    client.go_offboard()
    client.run(6, stream_hz=20, point=(6, 0, -2, 0, 0, 0, 0))
    assert client.mode() is Mode.HOLD and client.px4.commander.failsafe
    assert client.set_mode((6, 0)) == [0, 0]
    client.run(0.5, stream_hz=20, point=(6, 0, -2, 0, 0, 0, 0))
    assert client.mode() is Mode.OFFBOARD


def test_a_landing_is_slow_near_the_ground_only() -> None:
    client = Client(parameters={"MIS_TAKEOFF_ALT": 12.0})
    client.command(400, 1)
    client.command(22)
    client.run(14)
    client.set_mode(LAND)
    client.run(2)
    assert client.px4.commander.airframe.v_enu_m_s[2] == pytest.approx(-1.4, abs=0.15)
    client.run(7)
    assert client.px4.commander.airframe.v_enu_m_s[2] == pytest.approx(-0.7, abs=0.05)
