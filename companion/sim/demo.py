"""The demo's operator: starts the cast, engages, watches the truth, and ends the run when the vehicle says that it has
arrived.
"""

from __future__ import annotations

import asyncio
import bisect
import math
import signal
import socket
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from companion.core.clock import NS_PER_S, MonotonicClock
from companion.errors import CompanionError
from companion.host.control_socket import ask
from companion.host.unix_datagram import bind_datagram_socket
from companion.log.parts import parts_beside
from companion.log.truth import TRUTH_NAME, Truth, write_truth
from companion.sim import truth
from companion.sim.operator import engage
from companion.sim.stage import WORLD, Card, Cast, Stage, set_stage
from companion.sim.truth import WorldTruth

RENDEZVOUS_M: Final = 2.0
BEACON: Final = "beacon"
_READY_S: Final = 90.0  # the first start on a machine compiles the AOA kernel
_LOGS: Final = ("log.mcap", "beacon.mcap", TRUTH_NAME)
_PICTURES: Final = ("flight.png", "profile.png")
_POLL_S: Final = 0.25
_LEAVE_S: Final = 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Watch:
    """One look at the run: what the service says and what is true. `setpoint_rate_hz` is what the autopilot received
    over the last second or so."""

    elapsed_s: float
    status: dict[str, Any]
    truth: WorldTruth | None
    bearing_truth: WorldTruth | None
    """At the reference time of the bearing in `status`."""
    setpoint_rate_hz: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoRun:
    """What happened, before the log is read. `outcome` says in words how it ended."""

    reached: bool
    outcome: str
    engaged_ns: int
    flight_s: float
    setup_s: float
    closest_m: float
    truths: list[WorldTruth]
    stage: Stage


def refuse_flown(out: Path) -> None:
    """Raises CompanionError where the logs in `out`, which a run deletes, are of no demo: the world's own words are
    beside those that are."""
    logs = _logs_in(out)
    if logs and not (out / f"{WORLD}.txt").is_file():
        raise CompanionError(f"{logs[0]}: is there already, and of no demo; choose another folder with --out")


def _logs_in(out: Path) -> list[Path]:
    return [path for name in _LOGS for path in parts_beside(out / name)]


async def run_demo(
    seed: int,
    out: Path,
    max_time_s: float,
    on_watch: Callable[[Watch], None],
    *,
    gps: bool = False,
    scene: str | None = None,
    card: Card = "5300",
) -> DemoRun:
    """One rendezvous with everything real but the hardware; without `gps` the vehicle flies by the service's poses.
    `out` is an existing directory, `scene` and `card` as in `set_stage`.

    Raises CompanionError when the cast cannot start or one of it ends early.
    """
    for old in (*_logs_in(out), *(out / name for name in _PICTURES)):
        old.unlink(missing_ok=True)  # of an earlier run: a picture of it must not pass for one of this
    with tempfile.TemporaryDirectory(prefix="companion-") as name:
        stage = set_stage(Path(name), out, seed, gps=gps, scene=scene, card=card)
        with bind_datagram_socket(stage.truth_socket) as truth_socket:
            try:
                async with Cast(stage, out) as cast:
                    run = await _Operator(stage, cast, truth_socket, on_watch).run(max_time_s)
                write_truth(out / TRUTH_NAME, log_truths(run.truths))
                return run
            finally:
                for claim in stage.claims:
                    claim.close()


class _Operator:
    def __init__(
        self, stage: Stage, cast: Cast, truth_socket: socket.socket, on_watch: Callable[[Watch], None]
    ) -> None:
        self._stage = stage
        self._cast = cast
        self._socket = truth_socket
        self._on_watch = on_watch
        self._clock = MonotonicClock()
        self._start_ns = self._clock.now_ns()
        self._truths: list[WorldTruth] = []

    async def run(self, max_time_s: float) -> DemoRun:
        # A signal ends everything in order, as an interrupt does.
        task = asyncio.current_task()
        assert task is not None
        for number in (signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup has it
                asyncio.get_running_loop().add_signal_handler(number, task.cancel)
        await engage(self._stage.control_socket, _READY_S, self._status)
        engaged_ns = self._clock.now_ns()
        setup_s = (engaged_ns - self._start_ns) / NS_PER_S
        outcome, reached = f"no rendezvous within {max_time_s:g} s", False
        while (elapsed_s := (self._clock.now_ns() - engaged_ns) / NS_PER_S) < max_time_s:
            watch = await self._look(elapsed_s)
            if watch.status["state"] == "arrived" and watch.truth is not None:
                reached = watch.truth.distance_m <= RENDEZVOUS_M
                outcome = f"the vehicle says it has arrived, {watch.truth.distance_m:.2f} m from the robot"
                break
            if watch.status["state"] in ("fault", "latched", "idle"):
                outcome = f"the mission ended in state {watch.status['state']}: {watch.status['reason']}"
                break
        flight_s = (self._clock.now_ns() - engaged_ns) / NS_PER_S
        if reached:
            await self._watch_it_leave()
        closest_m = min((t.distance_m for t in self._truths), default=math.inf)
        return DemoRun(
            reached=reached,
            outcome=outcome,
            engaged_ns=engaged_ns,
            flight_s=flight_s,
            setup_s=setup_s,
            closest_m=closest_m,
            truths=self._truths,
            stage=self._stage,
        )

    async def _watch_it_leave(self) -> None:
        """Long enough to see whether anything is sent after OFFBOARD was left."""
        deadline_ns = self._clock.now_ns() + round(_LEAVE_S * NS_PER_S)
        while self._clock.now_ns() < deadline_ns:
            await asyncio.sleep(_POLL_S)
            self._drain_truth()

    async def _status(self) -> dict[str, Any] | None:
        try:
            status = (await self._look(0.0)).status
        except CompanionError:
            if self._cast.ended():
                raise
            return None
        return status if self._truths else status | {"not_ready": ["the world tells nothing of itself"]}

    async def _look(self, elapsed_s: float) -> Watch:
        await asyncio.sleep(_POLL_S)
        if ended := self._cast.ended():
            raise CompanionError(ended)
        self._drain_truth()
        status = await ask(self._stage.control_socket, "status")
        newest = self._truths[-1] if self._truths else None
        watch = Watch(
            elapsed_s=elapsed_s,
            status=status,
            truth=newest,
            bearing_truth=self._truth_at(status["bearing"]),
            setpoint_rate_hz=self._setpoint_rate(),
        )
        self._on_watch(watch)
        return watch

    def _drain_truth(self) -> None:
        while True:
            try:
                self._truths.append(truth.decode_world(self._socket.recv(4096)))
            except BlockingIOError:
                return

    def _truth_at(self, bearing: dict[str, Any] | None) -> WorldTruth | None:
        """The first truth at or after the reference time of a bearing; truths come at 20 Hz."""
        if bearing is None:
            return None
        place = bisect.bisect_left(self._truths, bearing["reference_ns"], key=lambda world: world.t_mono_ns)
        return self._truths[place] if place < len(self._truths) else None

    def _setpoint_rate(self) -> float:
        recent = self._truths[-25:]
        if len(recent) < 2:
            return 0.0
        first, last = recent[0], recent[-1]
        span_s = (last.vehicle.t_mono_ns - first.vehicle.t_mono_ns) / NS_PER_S
        return (last.vehicle.setpoints - first.vehicle.setpoints) / span_s if span_s > 0 else 0.0


def log_truths(truths: list[WorldTruth]) -> list[Truth]:
    """As they are written beside a log."""
    return [Truth(t.t_mono_ns, t.uav_antenna_enu_m, {BEACON: t.beacon_antenna_enu_m}) for t in truths]
