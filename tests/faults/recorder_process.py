"""A process that records at a flight's full rate until it is killed: `python -m tests.faults.recorder_process LOG`."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from companion.config.file import load_config
from companion.core.clock import MonotonicClock
from companion.core.event_clock import EventClock
from companion.core.inputs import Tick
from companion.core.messages import FlightMode, Pose, Setpoint, VehicleState, pose_bytes
from companion.core.streams import CSI, NEIGHBOUR, POSE, POSE_IN, SETPOINT, TICK, VEHICLE
from companion.log.recorder import McapRecorder
from tests.paths import CONFIGS

_CONFIG = CONFIGS / "uav.yaml"


def main() -> None:
    clock = EventClock(MonotonicClock())
    recorder = McapRecorder(Path(sys.argv[1]), load_config(_CONFIG), clock)
    print("recording", flush=True)
    pose = Pose(
        t_mono_ns=0,
        p_enu_m=(1.0, 2.0, 3.0),
        q_enu_from_body=(1.0, 0.0, 0.0, 0.0),
        v_enu_m_s=(0.0, 0.0, 0.0),
        confidence=3,
    )
    position, velocity = (1.0, 2.0, 3.0), (0.1, 0.2, 0.3)
    vehicle = VehicleState(
        t_mono_ns=1, heartbeat_mono_ns=1, mode=FlightMode.OFFBOARD, mode_mono_ns=1, armed=True, in_air=True,
        position_mono_ns=1, p_local_enu_m=position, v_local_enu_m_s=velocity, yaw_enu_rad=0.5, battery_remaining=0.9,
    )  # fmt: skip
    start_ns = clock.now_ns()
    for number in range(10**9):
        time.sleep(max(0.0, (start_ns + number * 5_000_000 - clock.now_ns()) / 1e9))
        with clock.event() as now_ns:
            recorder.record(POSE_IN, now_ns, pose_bytes(pose))
            if number % 4 == 0:
                recorder.record(POSE, now_ns, pose)
            else:
                recorder.record(CSI, now_ns, b"\xbb" + number.to_bytes(4, "little") * 57)
            if number % 10 == 0:
                recorder.record(TICK, now_ns, Tick(now_ns))
                recorder.record(VEHICLE, now_ns, vehicle)
                recorder.record(SETPOINT, now_ns, Setpoint(now_ns, position, velocity, 0.0))
            if number % 20 == 0:
                recorder.record(NEIGHBOUR, now_ns, bytes(474))


if __name__ == "__main__":
    main()
