"""What the edge makes of MAVLink messages as the library decodes them."""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import pytest

from companion.autopilot.telemetry import Telemetry, is_healthy
from companion.core.messages import FlightMode

_HEARTBEAT = {"custom_mode": 6 << 16, "base_mode": 129, "system_status": 4, "autopilot": 12}
_POSITION: dict[str, Any] = {"x": 1.0, "y": 2.0, "z": -3.0, "vx": 0.1, "vy": 0.2, "vz": -0.3, "time_boot_ms": 57_000}


class _Bench:
    def __init__(self) -> None:
        self.now_ns = 1000
        self.telemetry = Telemetry(lambda: self.now_ns)

    def take(self, name: str, fields: object, component_id: int = 1) -> None:
        self.telemetry.take(name, component_id, json.dumps(fields))


@pytest.fixture
def bench() -> _Bench:
    return _Bench()


def test_position_turns_from_ned_to_enu(bench: _Bench) -> None:
    bench.take("LOCAL_POSITION_NED", _POSITION)
    state = bench.telemetry.state()
    assert state.p_local_enu_m == (2.0, 1.0, 3.0)
    assert state.v_local_enu_m_s == (0.2, 0.1, 0.3)
    bench.take("ATTITUDE", {"yaw": math.radians(30), "time_boot_ms": 57_001})
    assert bench.telemetry.state().yaw_enu_rad == pytest.approx(math.radians(60))


def test_ages_are_those_of_arrival(bench: _Bench) -> None:
    bench.take("HEARTBEAT", _HEARTBEAT)
    bench.now_ns = 2000
    bench.take("CURRENT_MODE", {"custom_mode": 3 << 16})
    bench.now_ns = 9000
    state = bench.telemetry.state()
    assert (state.heartbeat_mono_ns, state.mode_mono_ns, state.t_mono_ns) == (1000, 2000, 9000)
    assert state.mode is FlightMode.MANUAL and state.armed and not state.failsafe


def test_failsafe_landed_state_and_battery(bench: _Bench) -> None:
    bench.take("HEARTBEAT", _HEARTBEAT | {"system_status": 5, "base_mode": 1})
    assert bench.telemetry.state().failsafe and not bench.telemetry.state().armed
    for landed_state, in_air in [(0, False), (1, False), (2, True), (3, True), (4, True)]:
        bench.take("EXTENDED_SYS_STATE", {"landed_state": landed_state})
        assert bench.telemetry.state().in_air is in_air
    bench.take("BATTERY_STATUS", {"id": 0, "battery_remaining": 42})
    assert bench.telemetry.state().battery_remaining == 0.42
    bench.take("BATTERY_STATUS", {"id": 0, "battery_remaining": -1})
    assert bench.telemetry.state().battery_remaining is None


def test_other_components_of_the_vehicle_are_not_the_autopilot(bench: _Bench) -> None:
    bench.take("HEARTBEAT", _HEARTBEAT, component_id=100)
    assert bench.telemetry.state().heartbeat_mono_ns is None


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("LOCAL_POSITION_NED", _POSITION | {"x": None}),
        ("LOCAL_POSITION_NED", _POSITION | {"vz": "fast"}),
        ("LOCAL_POSITION_NED", {"x": 1.0}),
        ("LOCAL_POSITION_NED", [1, 2, 3]),
        ("ATTITUDE", {"yaw": math.inf}),
        ("HEARTBEAT", {"custom_mode": None}),
        ("NO_SUCH", {}),
    ],
)
def test_what_does_not_fit_is_counted_and_changes_nothing(bench: _Bench, name: str, fields: object) -> None:
    bench.take("LOCAL_POSITION_NED", _POSITION)
    before = bench.telemetry.state()
    bench.now_ns = 5000
    bench.take(name, fields)
    assert bench.telemetry.malformed == 1
    bench.now_ns = before.t_mono_ns
    assert bench.telemetry.state() == before
    bench.telemetry.take("HEARTBEAT", 1, "{ not JSON")
    assert bench.telemetry.malformed == 2


def test_parameters_in_both_types_and_answers_to_commands(bench: _Bench) -> None:
    five = struct.unpack("<f", struct.pack("<i", 5))[0]
    bench.take("PARAM_VALUE", {"param_id": "COM_OBL_RC_ACT", "param_value": five, "param_type": 6})
    bench.take("PARAM_VALUE", {"param_id": "COM_OF_LOSS_T\0", "param_value": 1.5, "param_type": 9})
    bench.take("PARAM_VALUE", {"param_id": "NEGATIVE", "param_value": None, "param_type": 6})
    assert bench.telemetry.parameters == {"COM_OBL_RC_ACT": 5, "COM_OF_LOSS_T": 1.5, "NEGATIVE": None}
    bench.take("COMMAND_ACK", {"command": 176, "result": 0})
    bench.take("COMMAND_ACK", {"command": 176, "result": 1})
    assert bench.telemetry.acknowledgements == {176: 1}


@pytest.mark.parametrize(
    ("flags", "at_rest", "in_air"),
    [
        (1023, True, False),  # GPS, disarmed at rest
        (895, True, True),  # GPS
        (495, True, False),  # our poses, disarmed at rest
        (367, True, True),  # our poses
        (383, True, True),  # our poses, with an origin
        (229, False, False),  # no poses yet
        (111, False, False),  # no poses for 0.6 s
        (101, False, False),  # none for 5 s
        (895 | 2048, False, False),
    ],
)
def test_what_px4_says_of_its_estimator(flags: int, at_rest: bool, in_air: bool) -> None:
    assert (is_healthy(flags, in_air=False), is_healthy(flags, in_air=True)) == (at_rest, in_air)


def test_modes_intended_and_flown(bench: _Bench) -> None:
    bench.take("CURRENT_MODE", {"custom_mode": 4 << 16 | 3 << 24, "intended_custom_mode": 6 << 16})
    assert (bench.telemetry.state().mode, bench.telemetry.state().intended_mode) == (
        FlightMode.HOLD,
        FlightMode.OFFBOARD,
    )
    bench.take("CURRENT_MODE", {"custom_mode": 4 << 16 | 3 << 24, "intended_custom_mode": 0})
    assert bench.telemetry.state().intended_mode is None


def test_what_the_vehicle_is(bench: _Bench) -> None:
    bench.take("HEARTBEAT", _HEARTBEAT)
    bench.take("AUTOPILOT_VERSION", {"flight_sw_version": 0x011001FF})
    assert (bench.telemetry.state().autopilot, bench.telemetry.state().firmware) == ("px4", "1.16.1")
    bench.take("HEARTBEAT", _HEARTBEAT | {"autopilot": 3})
    assert bench.telemetry.state().autopilot == "ardupilot"
