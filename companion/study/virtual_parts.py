"""What stands in for hardware in a virtual mission: vehicle, worker process, cameras and cards."""

from __future__ import annotations

import asyncio
import math
from functools import lru_cache
from typing import Any

import numpy as np

from companion.core.clock import NS_PER_S, Clock
from companion.core.messages import AutopilotEvent, FlightMode, Pose, Setpoint, Vector3, VehicleState
from companion.core.streams import Stream
from companion.host.coalescing import Readers
from companion.pose.source import BodyFrame
from companion.radio.card import ANTENNAS, ChannelSample
from companion.sensing.worker import compute
from companion.sensing.worker_wire import AoaResult, request_of
from companion.sim.px4.airframe import Airframe, AirframeLimits, Demand, Gusts
from companion.sim.px4.wander import Wander
from companion.sim.radio import DEFAULT_EPOCH_NS, RadioLink
from companion.sim.scenario import Scenario
from companion.sim.trajectory import Trajectory
from companion.sim.vio import Camera
from companion.study.virtual_clock import VirtualClock
from csi_bridge.records import CsiRecord
from csi_bridge.scaling import total_rss_dbm
from wsr.aperture import Aperture
from wsr.crb.informativeness import Prior
from wsr.estimators import ESTIMATORS

UAV_ID, BEACON_ID = 1, 2
PARAMETERS = {
    "COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 5, "COM_RC_OVERRIDE": 3, "GF_ACTION": 2, "SYS_HAS_GPS": 1,
    "EKF2_EV_CTRL": 0, "RTL_RETURN_ALT": 2.0, "GF_MAX_VER_DIST": 0.0, "NAV_MC_ALT_RAD": 0.8,
    "COM_TAKEOFF_ACT": 0,
}  # fmt: skip
"""Of an autopilot that preflight has nothing against."""
AIRFRAME_S = 0.025
_total_rss_dbm = lru_cache(maxsize=4096)(total_rss_dbm)
_NOWHERE_ELSE = Prior(np.zeros(1), np.full(1, math.pi / 2), np.ones(1))
"""Nobody asks a virtual mission how much its apertures tell about other directions than the source's."""
_COMPUTE_S = 0.1  # that the worker needs on the vehicle's processor, and the flight waits for


class Vehicle:
    """An airframe that grants every mode at once; a `companion.autopilot.port.Autopilot`. Its estimate wanders."""

    def __init__(self, gust_seed: int, wander_seed: int, height_m: float, clock: VirtualClock) -> None:
        self._clock = clock
        self._wander = Wander(wander_seed)
        self._setpoint: Setpoint | None = None
        self._mode = FlightMode.HOLD
        self._hover_m: Vector3 = (0.0, 0.0, height_m)
        self.airframe = Airframe(AirframeLimits(), 0.0, Gusts(gust_seed))
        self.airframe.p_enu_m = self._hover_m

    def step(self) -> None:
        self.airframe.estimate_offset_enu_m = self._wander.step(AIRFRAME_S)
        if self._mode is FlightMode.OFFBOARD and self._setpoint is not None:
            s = self._setpoint
            place = (None, None, None) if s.p_local_enu_m is None else s.p_local_enu_m
            self.airframe.step(Demand(place, s.v_local_enu_m_s, s.yaw_enu_rad), AIRFRAME_S)
        else:
            self.airframe.step(Demand(self._hover_m, (0.0, 0.0, 0.0)), AIRFRAME_S)

    async def connect(self, timeout_s: float = 10.0) -> None: ...

    async def run(self) -> None: ...

    @property
    def problem(self) -> str:
        return ""

    async def aclose(self) -> None: ...

    def state(self) -> VehicleState:
        now_ns = self._clock.now_ns()
        return VehicleState(
            t_mono_ns=now_ns,
            heartbeat_mono_ns=now_ns,
            mode=self._mode,
            mode_mono_ns=now_ns,
            armed=True,
            in_air=True,
            position_mono_ns=now_ns,
            p_local_enu_m=self.airframe.estimated_p_enu_m,
            v_local_enu_m_s=self.airframe.v_enu_m_s,
            yaw_enu_rad=self.airframe.yaw_enu_rad,
            battery_remaining=1.0,
            estimator_mono_ns=now_ns,
            estimator_healthy=True,
            timesync_mono_ns=now_ns,
        )

    def send_setpoint(self, setpoint: Setpoint) -> None:
        self._setpoint = setpoint

    async def arm(self) -> None: ...

    async def takeoff(self, height_m: float) -> None: ...

    async def request_offboard(self) -> None:
        self._mode = FlightMode.OFFBOARD

    async def hold(self) -> None:
        self._hover_m, self._mode = self.airframe.estimated_p_enu_m, FlightMode.HOLD

    async def land(self) -> None:
        self._hover_m, self._mode = self.airframe.estimated_p_enu_m, FlightMode.LAND

    async def return_home(self) -> None:
        self._hover_m, self._mode = self.airframe.estimated_p_enu_m, FlightMode.RETURN

    def send_odometry(self, pose: Pose, reset_counter: int) -> None: ...

    def set_origin(self, latitude_deg: float, longitude_deg: float) -> None: ...

    def take_events(self) -> list[AutopilotEvent]:
        return []

    async def parameter(self, name: str) -> int | float:
        return PARAMETERS[name]


class InlineWorker:
    """The AOA worker's computation in this process; results are taken when their time has come."""

    def __init__(self, estimator: str, clock: Clock) -> None:
        self._estimator = ESTIMATORS[estimator]()
        self._clock = clock
        self._results: list[tuple[int, AoaResult]] = []
        self._next_id = 0
        self.ready = asyncio.Event()
        self.ready.set()

    def submit(self, peer: int, aperture: Aperture) -> int:
        request_id, self._next_id = self._next_id, self._next_id + 1
        result = compute(self._estimator, request_of(request_id, peer, aperture), _NOWHERE_ELSE)
        self._results.append((self._clock.now_ns() + round(_COMPUTE_S * NS_PER_S), result))
        return request_id

    def due(self, now_ns: int) -> list[AoaResult]:
        done = [result for at_ns, result in self._results if at_ns <= now_ns]
        self._results = [(at_ns, result) for at_ns, result in self._results if at_ns > now_ns]
        return done


class NullRecorder:
    """A `companion.core.recorder.Recorder` that keeps nothing."""

    failed = False

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None: ...

    def counters(self) -> dict[str, int]:
        return {}


class CameraFeed:
    """A camera with the times of its frames; poses come out in ENU, as the service's pose source gives them. Who flies
    asks for them: as a `companion.pose.port.Poses` it runs by nothing of its own."""

    malformed = 0
    resets = 0

    def __init__(self, scenario: Scenario, index: int, north_yaw_rad: float = 0.0) -> None:
        """`north_yaw_rad` is what the robot takes its camera's `frame_yaw_rad` for."""
        robot = (scenario.uav, scenario.beacon)[index]
        self._camera = Camera(scenario.vio, scenario.seed, index, robot.frame_yaw_rad)
        self.align(north_yaw_rad)
        self._period_s = 1 / scenario.vio.rate_hz
        # The other robot's clock is its own.
        self._offset_ns = round(robot.clock_offset_s * NS_PER_S)
        self._frame = 1
        self.received = 0

    def align(self, north_yaw_rad: float) -> None:
        self._body = BodyFrame(north_yaw_rad)

    async def run(self, readers: Readers | None = None) -> None: ...

    def close(self) -> None: ...

    def poses(self, until_s: float, robot: Trajectory) -> list[Pose]:
        count = max(0, math.floor(until_s / self._period_s) + 1 - self._frame)
        t_s = np.arange(self._frame, self._frame + count, dtype=np.float64) * self._period_s
        self._frame += count
        self.received += count
        p_m, yaw = robot.at(t_s)
        return [
            self._body.pose(self._camera.pose(round(t * NS_PER_S) + self._offset_ns, (p[0], p[1], p[2]), y))
            for t, p, y in zip(t_s.tolist(), p_m.tolist(), yaw.tolist(), strict=True)
        ]


class RadioFeed:
    """Records of the simulated cards as the service's channel samples, a batch at a time."""

    def __init__(self, scenario: Scenario) -> None:
        self._link = RadioLink(scenario)

    def skip_to(self, t_s: float) -> None:
        self._link.skip_to(t_s)

    def samples(self, until_s: float, uav: Trajectory, beacon: Trajectory) -> list[tuple[bool, ChannelSample]]:
        at_uav, at_beacon = self._link.advance(until_s, uav, beacon)
        return [(True, s) for s in _samples(at_uav, BEACON_ID)] + [(False, s) for s in _samples(at_beacon, UAV_ID)]


def _samples(records: list[CsiRecord], peer: int) -> list[ChannelSample]:
    """The same values as `companion.radio.card.Radio` gives, of cards that hear with all their antennas."""
    samples = []
    for record in records:
        assert record.n_rx == ANTENNAS
        csi = record.csi[:, :, 0]
        t_ns = (record.host_time_ns or 0) - DEFAULT_EPOCH_NS
        power_dbm = _total_rss_dbm(record.rssi, record.agc)
        samples.append(
            ChannelSample(
                peer=peer,
                frame=record.frame_count,
                t_mono_ns=t_ns,
                nic_us=record.timestamp_low_us,
                channel=csi,
                power_dbm=power_dbm,
            )
        )
    return samples
