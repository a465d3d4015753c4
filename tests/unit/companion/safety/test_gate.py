"""The gate: each limit at its edge, and random plans of which no bad one may pass."""

from __future__ import annotations

import dataclasses
import math
import random

import pytest

from companion.core.messages import FlightMode, Setpoint, Vector3, VehicleState
from companion.safety.gate import Gate, GateLimits, Reason, turned
from tests.faults.campaigns import runs
from tests.faults.figures import record

_NOW_NS = 1_000_000_000_000
_LIMITS = GateLimits(
    fence_min_m=(-10.0, -10.0, -1.0),
    fence_max_m=(10.0, 10.0, 5.0),
    fence_radius_m=12.0,
    max_speed_m_s=1.0,
    max_climb_m_s=0.5,
    max_acceleration_m_s2=3.0,
    min_height_m=0.5,
)
_GATE = Gate(_LIMITS)
_STATE = VehicleState(
    t_mono_ns=_NOW_NS,
    heartbeat_mono_ns=_NOW_NS,
    mode=FlightMode.OFFBOARD,
    armed=True,
    in_air=True,
    position_mono_ns=_NOW_NS - 20_000_000,
    p_local_enu_m=(1.0, 2.0, 1.5),
    v_local_enu_m_s=(0.3, 0.0, 0.1),
    yaw_enu_rad=0.7,
)
_GOOD = Setpoint(_NOW_NS - 1_000_000, (1.2, 2.1, 1.6), (0.4, 0.1, 0.0), 0.8)
_HOLD = Setpoint(_NOW_NS, (1.0, 2.0, 1.5), (0.0, 0.0, 0.0), 0.7)


def _at(p_m: Vector3) -> VehicleState:
    return dataclasses.replace(_STATE, p_local_enu_m=p_m)


def test_good_set_point_passes_unchanged() -> None:
    verdict = _GATE.check(_GOOD, _STATE, _NOW_NS, True)
    assert verdict.setpoint is _GOOD
    assert verdict.reasons == ()


@pytest.mark.parametrize("yaw_deg", [30.0, -120.0, 90.0])
def test_a_box_turned_with_the_walls_refuses_beyond_them_and_nowhere_else(yaw_deg: float) -> None:
    limits = dataclasses.replace(_LIMITS, fence_min_m=(-2.0, -10.0, -1.0), fence_yaw_deg=yaw_deg)
    ahead = math.radians(yaw_deg)
    for along_m, across_m, is_inside in ((9.9, 0.0, True), (10.1, 0.0, False), (-1.9, 0.0, True), (-2.1, 0.0, False),
                                         (0.0, 9.9, True), (0.0, -10.1, False)):  # fmt: skip
        e_m = along_m * math.cos(ahead) - across_m * math.sin(ahead)
        n_m = along_m * math.sin(ahead) + across_m * math.cos(ahead)
        setpoint = dataclasses.replace(_GOOD, p_local_enu_m=(e_m, n_m, 1.5))
        reasons = Gate(limits).check(setpoint, _at((e_m, n_m, 1.5)), _NOW_NS, True).reasons
        assert reasons == (() if is_inside else (Reason.FENCE_BOX,))


def test_nothing_is_sent_in_a_foreign_mode() -> None:
    verdict = _GATE.check(_GOOD, _STATE, _NOW_NS, False)
    assert verdict.setpoint is None and verdict.reasons == (Reason.MODE,)
    assert verdict.reasons


@pytest.mark.parametrize(
    ("setpoint", "reason"),
    [
        (dataclasses.replace(_GOOD, t_mono_ns=_NOW_NS - 200_000_001), Reason.STALE),
        (dataclasses.replace(_GOOD, t_mono_ns=_NOW_NS + 1), Reason.STALE),
        (dataclasses.replace(_GOOD, p_local_enu_m=(math.nan, 2.0, 1.5)), Reason.NOT_FINITE),
        (dataclasses.replace(_GOOD, v_local_enu_m_s=(0.0, math.inf, 0.0)), Reason.NOT_FINITE),
        (dataclasses.replace(_GOOD, yaw_enu_rad=math.nan), Reason.NOT_FINITE),
        (dataclasses.replace(_GOOD, p_local_enu_m=(1.2, 2.1, 0.49)), Reason.HEIGHT),
        (dataclasses.replace(_GOOD, p_local_enu_m=(3.01, 2.0, 1.5)), Reason.LEAD),
        (dataclasses.replace(_GOOD, v_local_enu_m_s=(0.8, 0.61, 0.0)), Reason.SPEED),
        (dataclasses.replace(_GOOD, v_local_enu_m_s=(0.3, 0.0, 0.51)), Reason.CLIMB),
        (dataclasses.replace(_GOOD, v_local_enu_m_s=(0.3, 0.0, -0.51)), Reason.CLIMB),
    ],
)
def test_bad_set_point_becomes_a_hold_and_says_why(setpoint: Setpoint, reason: Reason) -> None:
    verdict = _GATE.check(setpoint, _STATE, _NOW_NS, True)
    assert verdict.setpoint == _HOLD
    assert verdict.reasons == (reason,)


@pytest.mark.parametrize(
    ("p_m", "reasons"),
    [
        ((10.01, 0.0, 1.5), (Reason.FENCE_BOX,)),
        ((-10.01, 0.0, 1.5), (Reason.FENCE_BOX,)),
        ((0.0, 0.0, 5.01), (Reason.FENCE_BOX,)),
        ((8.7, -8.7, 1.5), (Reason.FENCE_CYLINDER,)),
        ((10.5, -8.7, 1.5), (Reason.FENCE_BOX, Reason.FENCE_CYLINDER)),
        ((-8.7, 8.7, 1.5), (Reason.FENCE_CYLINDER,)),
        ((0.0, -10.01, 1.5), (Reason.FENCE_BOX,)),
    ],
)
def test_fence(p_m: Vector3, reasons: tuple[Reason, ...]) -> None:
    verdict = _GATE.check(dataclasses.replace(_GOOD, p_local_enu_m=p_m), _at(p_m), _NOW_NS, True)
    assert verdict.reasons == reasons
    assert verdict.setpoint is not None and verdict.setpoint.v_local_enu_m_s == (0.0, 0.0, 0.0)


def test_a_set_point_back_into_the_fence_passes() -> None:
    inward = dataclasses.replace(_GOOD, p_local_enu_m=(9.8, 0.0, 1.5), v_local_enu_m_s=(-0.4, 0.0, 0.0))
    assert not _GATE.check(inward, _at((10.6, 0.0, 1.5)), _NOW_NS, True).reasons


def test_acceleration_is_judged_from_the_velocity_flown() -> None:
    forward = dataclasses.replace(_STATE, v_local_enu_m_s=(0.9, 0.0, 0.0))
    back = dataclasses.replace(_GOOD, v_local_enu_m_s=(-0.61, 0.0, 0.0))
    assert _GATE.check(back, forward, _NOW_NS, True).reasons == (Reason.ACCELERATION,)
    slower = dataclasses.replace(_GOOD, v_local_enu_m_s=(-0.59, 0.0, 0.0))
    assert not _GATE.check(slower, forward, _NOW_NS, True).reasons


@pytest.mark.parametrize(
    "known",
    [
        {"p_local_enu_m": None},
        {"v_local_enu_m_s": None},
        {"yaw_enu_rad": None},
        {"position_mono_ns": None},
        {"position_mono_ns": _NOW_NS - 500_000_001},
        {"p_local_enu_m": (math.nan, 0.0, 0.0)},
        {"v_local_enu_m_s": (0.0, math.inf, 0.0)},
        {"yaw_enu_rad": math.nan},
    ],
)
def test_without_a_usable_position_nothing_is_sent(known: dict[str, object]) -> None:
    state = dataclasses.replace(_STATE, **known)  # type: ignore[arg-type]
    verdict = _GATE.check(_GOOD, state, _NOW_NS, True)
    assert verdict.setpoint is None and verdict.reasons == (Reason.NO_POSITION,)


def test_telemetry_younger_than_the_tick_is_used() -> None:
    state = dataclasses.replace(_STATE, position_mono_ns=_NOW_NS + 1_000_000)
    assert not _GATE.check(_GOOD, state, _NOW_NS, True).reasons


@pytest.mark.parametrize(
    ("setpoint", "allowed"),
    [  # exactly at each limit, and the next number beyond it
        (dataclasses.replace(_GOOD, t_mono_ns=_NOW_NS - 200_000_000), True),
        (dataclasses.replace(_GOOD, t_mono_ns=_NOW_NS), True),
        (dataclasses.replace(_GOOD, p_local_enu_m=(1.0, 2.0, 0.5)), True),
        (dataclasses.replace(_GOOD, p_local_enu_m=(1.0, 2.0, math.nextafter(0.5, 0))), False),
        (dataclasses.replace(_GOOD, p_local_enu_m=(3.0, 2.0, 1.5)), True),
        (dataclasses.replace(_GOOD, p_local_enu_m=(math.nextafter(3.0, 4), 2.0, 1.5)), False),
        (dataclasses.replace(_GOOD, v_local_enu_m_s=(1.0, 0.0, 0.0)), True),
        (dataclasses.replace(_GOOD, v_local_enu_m_s=(math.nextafter(1.0, 2), 0.0, 0.0)), False),
        (dataclasses.replace(_GOOD, v_local_enu_m_s=(0.3, 0.0, 0.5)), True),
        (dataclasses.replace(_GOOD, v_local_enu_m_s=(0.3, 0.0, -0.5)), True),
        (dataclasses.replace(_GOOD, v_local_enu_m_s=(0.3, 0.0, math.nextafter(0.5, 1))), False),
    ],
)
def test_limits_at_their_very_edge(setpoint: Setpoint, allowed: bool) -> None:
    assert (not _GATE.check(setpoint, _STATE, _NOW_NS, True).reasons) is allowed


def test_the_edge_of_fence_acceleration_and_telemetry() -> None:
    on_box = (10.0, 0.0, 1.5)
    assert not _GATE.check(dataclasses.replace(_GOOD, p_local_enu_m=on_box), _at(on_box), _NOW_NS, True).reasons
    low_box = (-10.0, 0.0, 1.5)
    assert not _GATE.check(dataclasses.replace(_GOOD, p_local_enu_m=low_box), _at(low_box), _NOW_NS, True).reasons
    on_cylinder = (7.2, 9.6, 1.5)  # 12 m from the axis: a triangle of 3, 4 and 5
    assert not _GATE.check(
        dataclasses.replace(_GOOD, p_local_enu_m=on_cylinder), _at(on_cylinder), _NOW_NS, True
    ).reasons
    at_rest = dataclasses.replace(_STATE, v_local_enu_m_s=(-0.5, 0.0, 0.0), position_mono_ns=_NOW_NS - 500_000_000)
    hardest = dataclasses.replace(_GOOD, v_local_enu_m_s=(1.0, 0.0, 0.0))
    assert not _GATE.check(hardest, at_rest, _NOW_NS, True).reasons


def _neighbour_verdict(x_m: float, neighbour: Vector3, own: Vector3 = (1.0, 2.0, 1.5)) -> tuple[Reason, ...]:
    offered = dataclasses.replace(_GOOD, p_local_enu_m=(x_m, 2.0, 1.5))
    return _GATE.check(offered, _at(own), _NOW_NS, True, neighbours=[(-9.0, -9.0, 0.0), neighbour]).reasons


def test_a_neighbour_is_kept_at_a_distance() -> None:
    assert _neighbour_verdict(1.5, (2.5, 2.0, 1.5)) == ()
    assert _neighbour_verdict(math.nextafter(1.5, 2), (2.5, 2.0, 1.5)) == (Reason.NEIGHBOUR,)
    assert _neighbour_verdict(1.2, (1.2, 2.0, 2.4)) == (Reason.NEIGHBOUR,), "above counts as beside does"


def test_who_is_too_near_to_a_neighbour_may_stay_or_go_away_but_not_come_nearer() -> None:
    near = (1.5, 2.0, 1.5)
    assert _neighbour_verdict(1.0, near) == ()
    assert _neighbour_verdict(0.8, near) == ()
    assert _neighbour_verdict(1.1, near) == (Reason.NEIGHBOUR,)


def test_a_neighbour_whose_place_is_no_number_refuses() -> None:
    assert _neighbour_verdict(1.2, (math.nan, 2.0, 1.5)) == (Reason.NEIGHBOUR,)


def test_a_velocity_alone_is_judged_by_where_it_leads() -> None:
    """Half a second, the time the vehicle is given to respond, ahead of where it is."""
    fast = dataclasses.replace(_STATE, v_local_enu_m_s=(0.9, 0.0, 0.0))
    alone = Setpoint(_NOW_NS, None, (1.0, 0.0, 0.0), None)
    assert _GATE.check(alone, fast, _NOW_NS, True).setpoint is alone
    at_edge = dataclasses.replace(fast, p_local_enu_m=(9.51, 0.0, 1.5))
    assert _GATE.check(alone, at_edge, _NOW_NS, True).reasons == (Reason.FENCE_BOX,)
    assert not _GATE.check(alone, dataclasses.replace(at_edge, p_local_enu_m=(9.5, 0.0, 1.5)), _NOW_NS, True).reasons
    slower = Setpoint(_NOW_NS, None, (0.8, 0.0, 0.0), None)
    assert not _GATE.check(slower, dataclasses.replace(at_edge, p_local_enu_m=(9.59, 0.0, 1.5)), _NOW_NS, True).reasons
    assert _GATE.check(slower, dataclasses.replace(at_edge, p_local_enu_m=(9.61, 0.0, 1.5)), _NOW_NS, True).reasons
    down = Setpoint(_NOW_NS, None, (0.3, 0.0, -0.5), 0.7)
    assert _GATE.check(down, _at((1.0, 2.0, 0.74)), _NOW_NS, True).reasons == (Reason.HEIGHT,)
    verdict = _GATE.check(Setpoint(_NOW_NS, None, (math.nan, 0.0, 0.0), None), _STATE, _NOW_NS, True)
    assert verdict.reasons == (Reason.NOT_FINITE,) and verdict.setpoint == _HOLD


@pytest.mark.parametrize(
    ("p_m", "v_m_s"),
    [
        ((0.0, 9.6, 1.5), (0.0, 0.8, 0.0)),
        ((0.0, -9.6, 1.5), (0.0, -0.8, 0.0)),
        ((0.0, 0.0, 4.75), (0.0, 0.0, 0.5)),
    ],
)
def test_a_velocity_alone_leads_along_each_axis(p_m: Vector3, v_m_s: Vector3) -> None:
    """Half a second on is the fence: refused from 1 cm beyond, and not from 1 cm before."""
    alone, outward = Setpoint(_NOW_NS, None, v_m_s, None), [math.copysign(0.01, v) if v else 0.0 for v in v_m_s]
    x, y, z = p_m
    dx, dy, dz = outward
    assert _GATE.check(alone, _at((x + dx, y + dy, z + dz)), _NOW_NS, True).reasons == (Reason.FENCE_BOX,)
    assert _GATE.check(alone, _at((x - dx, y - dy, z - dz)), _NOW_NS, True).reasons == ()


@pytest.mark.parametrize("angle_rad", [1.0, -1.0, math.pi / 2])
def test_turning_is_counter_clockwise_about_the_vertical(angle_rad: float) -> None:
    x, y, z = turned((1.0, 2.0, 3.0), angle_rad)
    both = complex(1.0, 2.0) * complex(math.cos(angle_rad), math.sin(angle_rad))
    assert (x, y, z) == pytest.approx((both.real, both.imag, 3.0), abs=1e-12)


def test_without_an_angle_nothing_is_turned() -> None:
    vector = (0.1, -0.0, 3.0)
    assert turned(vector, 0.0) is vector


def test_several_reasons_are_all_named() -> None:
    wild = Setpoint(_NOW_NS - 10**9, (99.0, 0.0, -3.0), (5.0, 0.0, 5.0), 0.0)
    nobody_there = (math.nan, 0.0, 0.0)
    reasons = _GATE.check(wild, _STATE, _NOW_NS, True, neighbours=[nobody_there]).reasons
    assert set(reasons) == set(Reason) - {Reason.MODE, Reason.NO_POSITION, Reason.NOT_FINITE}


def test_fault_11_no_bad_set_point_of_a_random_plan_passes() -> None:
    """Whatever is offered, what comes out meets every limit by a check written apart from the gate's.

    `make faults` offers a million.
    """
    rng = random.Random(11)
    pool = [math.nan, math.inf, -math.inf, 1e308, -1e308, 0.0, 0.5, -0.5, 1.0, 2.0, 11.0]

    def number() -> float:
        return rng.choice(pool) if rng.random() < 0.05 else rng.gauss(0, 1.2)

    def is_bad(sent: Setpoint) -> bool:
        if sent.p_local_enu_m is None or not sent.is_finite():
            return True
        (px, py, pz), (sx, sy, sz) = sent.p_local_enu_m, sent.v_local_enu_m_s
        good = (
            _NOW_NS - 2 * 10**8 <= sent.t_mono_ns <= _NOW_NS,
            px * px + (py - 2) ** 2 + (pz - 1.5) ** 2 >= 1.0 - 1e-12,
            max(abs(px), abs(py)) <= 10 and 0.5 <= pz <= 5 and px * px + py * py <= 144,
            sx * sx + sy * sy <= 1.0 + 1e-12 and abs(sz) <= 0.5,
            (px - 1) ** 2 + (py - 2) ** 2 + (pz - 1.5) ** 2 <= 4.0 + 1e-12,
            (sx - 0.3) ** 2 + sy * sy + (sz - 0.1) ** 2 <= 1.5**2 + 1e-12,
        )
        return not all(good)

    passed = bad = 0
    offers = runs(20_000, 1_000_000)
    neighbour = (0.0, 2.0, 1.5)
    for _ in range(offers):
        t_ns = _NOW_NS - rng.choice([0, 10**6, 10**8, 3 * 10**8, -(10**6)])
        x, y, z, vx, vy, vz, yaw = (number() for _ in range(7))
        offered = Setpoint(t_ns, (1 + x, 2 + y, 1.5 + z), (vx, vy, vz), yaw)
        sent = _GATE.check(offered, _STATE, _NOW_NS, True, neighbours=[neighbour]).setpoint
        bad += sent is None or is_bad(sent)
        passed += sent is offered
    record(11, offered=offers, passed_unchanged=passed, bad_passed=bad)
    assert bad == 0
    assert offers // 200 < passed < offers // 2


def test_an_age_is_a_difference_whatever_the_numbers() -> None:
    for t_ns in (1, _NOW_NS // 3, 2 * _NOW_NS):
        offered = dataclasses.replace(_GOOD, t_mono_ns=t_ns)
        assert _GATE.check(offered, _STATE, _NOW_NS, True).reasons == (Reason.STALE,)


def test_nothing_of_the_gate_can_be_changed_afterwards() -> None:
    verdict = _GATE.check(_GOOD, _STATE, _NOW_NS, True)
    for thing, name in ((_GATE, "limits"), (_LIMITS, "max_speed_m_s"), (verdict, "reasons")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(thing, name, None)
        assert not hasattr(thing, "__dict__")


def test_limits_that_can_never_be_met_are_refused() -> None:
    with pytest.raises(ValueError, match="fence_min_m"):
        dataclasses.replace(_LIMITS, fence_min_m=(0.0, 0.0, 5.0))
    with pytest.raises(ValueError, match="max_speed_m_s"):
        dataclasses.replace(_LIMITS, max_speed_m_s=0.0)
    with pytest.raises(ValueError, match="min_height_m"):
        dataclasses.replace(_LIMITS, min_height_m=math.nan)
    for name in ("fence_radius_m", "max_climb_m_s", "max_acceleration_m_s2", "max_age_s", "response_s"):
        with pytest.raises(ValueError, match=f"{name} is 0"):
            dataclasses.replace(_LIMITS, **{name: 0.0})  # type: ignore[arg-type]
    for name in ("max_position_age_s", "min_neighbour_m"):
        with pytest.raises(ValueError, match=f"{name} is -1.0; expected a positive number"):
            dataclasses.replace(_LIMITS, **{name: -1.0})  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"fence_min_m .* must lie below fence_max_m .* on each axis"):
        dataclasses.replace(_LIMITS, fence_min_m=(10.0, -10.0, -1.0))
    with pytest.raises(ValueError, match="on each axis"):
        dataclasses.replace(_LIMITS, fence_min_m=(11.0, -10.0, -1.0))
    with pytest.raises(ValueError, match="max_lead_m"):
        dataclasses.replace(_LIMITS, max_lead_m=math.nan)


@pytest.mark.parametrize(("ground_m", "passes"), [(-0.4, True), (0.0, True), (1.49, True), (1.51, False), (-9.0, True)])
def test_the_least_height_counts_from_where_the_vehicle_stood(ground_m: float, passes: bool) -> None:
    level = dataclasses.replace(_GOOD, p_local_enu_m=(1.2, 2.1, 1.99), v_local_enu_m_s=(0.0, 0.0, 0.0))
    verdict = _GATE.check(level, _at((1.0, 2.0, 1.9)), _NOW_NS, True, ground_m=ground_m)
    assert (Reason.HEIGHT not in verdict.reasons) is passes


def test_a_place_is_inside_up_to_the_very_edge() -> None:
    limits = _GATE.limits
    low, high = limits.fence_min_m, limits.fence_max_m
    assert limits.is_in_box(low) and limits.is_in_box(high)
    for axis in range(3):
        for corner, step in ((low, -0.01), (high, 0.01)):
            out = [*corner]
            out[axis] += step
            assert not limits.is_in_box((out[0], out[1], out[2]))
    assert limits.is_in_cylinder((limits.fence_radius_m, 0.0, 99.0))
    assert not limits.is_in_cylinder((0.0, limits.fence_radius_m + 0.01, 0.0))
    assert not limits.is_in_cylinder((float("nan"), 0.0, 0.0))


def test_a_rover_has_no_least_height_and_is_moved_neither_up_nor_down() -> None:
    gate = Gate(dataclasses.replace(_LIMITS, on_ground=True))
    stands = dataclasses.replace(_STATE, p_local_enu_m=(1.0, 2.0, 0.0), v_local_enu_m_s=(0.0, 0.0, 0.0))
    drive = Setpoint(_NOW_NS, None, (0.4, 0.1, 0.0), None)
    assert gate.check(drive, stands, _NOW_NS, True).reasons == ()
    assert Reason.HEIGHT in _GATE.check(drive, stands, _NOW_NS, True).reasons
    for up_m_s in (1e-6, -1e-6, 0.4):
        climb = dataclasses.replace(drive, v_local_enu_m_s=(0.4, 0.1, up_m_s))
        assert gate.check(climb, stands, _NOW_NS, True).reasons == (Reason.CLIMB,)
    beyond = dataclasses.replace(stands, p_local_enu_m=(9.9, 2.0, 0.0))
    assert gate.check(drive, beyond, _NOW_NS, True).reasons == (Reason.FENCE_BOX,)
