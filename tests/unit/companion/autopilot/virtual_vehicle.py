"""The edge and the mock autopilot joined without sockets, library or waiting: time passes only in `run`."""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import msgspec
from pymavlink.dialects.v20 import development as mavlink

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.core.clock import NS_PER_S
from companion.core.messages import Pose, VehicleState
from companion.sim.px4.autopilot import Px4
from tests.manual_clock import ManualClock

_STEP_S = 0.01
_EVENT = 410
_WATCH_S = 0.1


class VirtualVehicle:
    """Stands in for the edge's `MavsdkLink`. Datagrams take `delay_s` each way."""

    url = "virtual"
    system_id = 1

    def __init__(self, delay_s: float = 0.002, clock: ManualClock | None = None, **options: Any) -> None:
        self.clock = clock or ManualClock(6844 * NS_PER_S)
        self.px4 = Px4(self.clock.now_ns(), **options)
        self.edge = MavsdkAutopilot(self.url, self.clock)
        self.edge._link = self  # type: ignore[assignment]
        self.edge._telemetry.identify(self.system_id)
        self.sent: list[str] = []
        self.poses: float | None = None
        """How old our poses are when they are sent [s]; None for none."""
        self.watches = True
        """Whether the edge looks after its telemetry by itself, as it does in `MavsdkAutopilot.watch`."""
        self._pose_s = 1 / 30
        self._delay_s = delay_s
        self._mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
        self._parser = mavlink.MAVLink(None)
        names = set(self.edge._telemetry.message_names)
        self._wanted = {number for number, message in mavlink.mavlink_map.items() if message.msgname in names}
        self._to_px4: list[bytes] = []

    def quiet(self) -> None:
        """For long times: only what tells the time, the estimator and the mode, and poses at 10 Hz."""
        self._pose_s = 0.1
        for name in ("ATTITUDE", "ODOMETRY", "SYS_STATUS", "EXTENDED_SYS_STATE", "GPS_RAW_INT", "GLOBAL_POSITION_INT"):
            self.px4.link.streams._period_ns[name] = -1
        for name in ("LOCAL_POSITION_NED", "CURRENT_MODE", "ESTIMATOR_STATUS"):
            self.px4.link.streams._period_ns[name] = NS_PER_S

    def state(self) -> VehicleState:
        return self.edge.state()

    def send(self, name: str, /, **fields: Any) -> None:
        self.sent.append(name)
        filled = {key: _filled(value) for key, value in fields.items()}
        message = getattr(mavlink, f"MAVLink_{name.lower()}_message")(**filled)
        self._to_px4.append(message.pack(self._mav))

    def send_addressed(self, name: str, **fields: Any) -> None:
        # pymavlink knows TIMESYNC without its newer fields.
        address = {} if name == "TIMESYNC" else {"target_system": self.system_id, "target_component": 1}
        self.send(name, **address, **fields)

    def run(self, seconds: float) -> None:
        watch_s = pose_s = 0.0
        for _ in range(round(seconds / _STEP_S)):
            self.clock.advance(_STEP_S)
            self._deliver(self.px4.step(self.clock.now_ns()))
            watch_s, pose_s = watch_s + _STEP_S, pose_s + _STEP_S
            if self.watches and watch_s >= _WATCH_S:
                watch_s = 0.0
                self.edge._ask_again()
            if self.poses is not None and pose_s >= self._pose_s:
                pose_s = 0.0
                self._send_pose(self.poses)
            self._flush()

    def _send_pose(self, age_s: float) -> None:
        t_ns = self.clock.now_ns() - round(age_s * NS_PER_S)
        place = self.px4.commander.airframe.p_enu_m
        self.edge.send_odometry(
            Pose(
                t_mono_ns=t_ns,
                p_enu_m=place,
                q_enu_from_body=(1.0, 0.0, 0.0, 0.0),
                v_enu_m_s=(0.0, 0.0, 0.0),
                confidence=3,
            ),
            0,
        )

    def _flush(self) -> None:
        while self._to_px4:
            datagrams, self._to_px4 = self._to_px4, []
            self.clock.advance(self._delay_s)
            for datagram in datagrams:
                self._deliver(self.px4.receive(datagram, self.clock.now_ns()))

    def _deliver(self, datagrams: list[bytes]) -> None:
        if not datagrams:
            return
        self.clock.advance(self._delay_s)
        for datagram in datagrams:
            number = int.from_bytes(datagram[7:10], "little")  # of a MAVLink 2 frame
            if number != _EVENT and number not in self._wanted:  # as the library: nobody has subscribed to it
                continue
            for message in self._parser.parse_buffer(datagram) or []:
                name = message.get_type()
                if number == _EVENT and message.data[5] == self.system_id:
                    self.edge._telemetry.take("EVENT", message.data[6], json.dumps(_event(bytes(message.data))))
                elif number != _EVENT and message.get_srcSystem() == self.system_id:
                    # Like the library msgspec writes null for NaN.
                    fields = msgspec.json.encode(message.to_dict()).decode()
                    self.edge._telemetry.take(name, message.get_srcComponent(), fields)


def _event(frame: bytes) -> dict[str, Any]:
    """What the library knows and pymavlink does not: MAVLink 2 with the zeros at its end cut off."""
    payload = frame[10:-2].ljust(53, b"\0")
    number, boot_ms, sequence = struct.unpack_from("<IIH", payload)
    return {
        "id": number, "event_time_boot_ms": boot_ms, "sequence": sequence,
        "log_levels": payload[12], "arguments": list(payload[13:]),
    }  # fmt: skip


def _filled(value: Any) -> Any:
    if value is None:
        return math.nan
    if isinstance(value, list):
        return [math.nan if item is None else item for item in value]
    return value.encode() if isinstance(value, str) else value
