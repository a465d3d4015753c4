"""SAR iterations: cut apertures out of the flight, have them computed, and turn the answers into bearings."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final, Protocol

import numpy as np

from companion.config.schema import ApertureConfig
from companion.core.clock import NS_PER_S
from companion.core.event_clock import EventClock
from companion.core.inputs import Answer, WorkerState
from companion.core.messages import Vector3
from companion.core.output import Output
from companion.core.recorder import Recorder
from companion.core.streams import ANSWER, APERTURE, BEARING, PROFILE, WORKER
from companion.neighbours.neighbour import Neighbour
from companion.sensing.frame_turn import DRIFT, UNKNOWN, FrameTurn, frame_turn
from companion.sensing.history import History
from companion.sensing.lookalikes import Lookalikes
from companion.sensing.records import ApertureRecord, Iteration
from companion.sensing.window import ApertureReport, SarWindow
from companion.sensing.worker_wire import AoaResult
from wsr.aperture import Aperture

_LOCAL_CAPACITY = 20 * 120
_LONGEST_S = 20.0
"""A path that takes longer than this has no aperture: poses drift, and nobody wants an old bearing."""
_FIRST: Final = 0.5
"""Of `length_m` is enough for the first apertures: a coarse bearing now is worth more than a fine one in a second."""
_IMPATIENT: Final = 0.5
"""Of `period_s`, between these, until one gives a bearing: which way the vehicle flies until then is chance."""

_TURNED_NS: Final = 50 * NS_PER_S
_TURN_STEP_NS: Final = NS_PER_S // 4
_JUMP_M: Final = 0.4
"""Between two ticks: an estimator that was set anew."""


class Worker(Protocol):
    """Computes apertures; its answers come back through `SarIterations.take_answer`, in any order."""

    ready: asyncio.Event
    """Set while it waits for apertures."""

    def submit(self, peer: int, aperture: Aperture) -> int:
        """Takes an aperture and returns the id its answer will carry."""


class SarIterations:
    """Numbers the iterations, records what goes to the worker and what came of it; `iterations` gives each."""

    def __init__(
        self,
        *,
        window: SarWindow,
        worker: Worker,
        neighbours: Mapping[int, Neighbour],
        config: ApertureConfig,
        clock: EventClock,
        recorder: Recorder,
        lookalikes: Lookalikes,
        pose_problem: Callable[[int, int], str],
        drift: float = DRIFT,
    ) -> None:
        """`pose_problem` says why an aperture between two times cannot be trusted, or nothing. Poses drift off
        by a share `drift` of the way."""
        self._window = window
        self._worker = worker
        self._neighbours = neighbours
        self._config = config
        self._clock = clock
        self._recorder = recorder
        self._lookalikes = lookalikes
        self._pose_problem = pose_problem
        self._drift = drift
        self._local = History(_LOCAL_CAPACITY, 3)
        self._pending: dict[int, tuple[int, ApertureReport]] = {}
        self._moved_m: Vector3 = (0.0, 0.0, 0.0)
        """By how much the local frame was set anew since these were cut."""
        self._begun_ns: int | None = None
        self._finished_ns: int | None = None
        self._looked_ns = 0
        self._was_short = False
        self._measured_ns: dict[int, int] = {}
        """By peer: the end of what bearings have told so far."""
        self._number = 0
        self.iterations = Output[Iteration]()

    def add_local_position(self, t_ns: int, p_local_enu_m: Vector3) -> None:
        self._local.append(t_ns, p_local_enu_m)

    def begin(self) -> None:
        """From here on the flight is measured, if it is not already."""
        if self._begun_ns is None:
            self._begun_ns = self._clock.now_ns()

    def abandon(self) -> None:
        """Nothing comes of the flight so far: the next aperture begins after the next `begin`."""
        self._begun_ns = None

    def shift(self, delta_enu_m: Vector3) -> None:
        """The autopilot's local frame was set anew: all places in it are `delta_enu_m` elsewhere, those of apertures
        that are being computed too. No aperture may span the step."""
        x, y, z = (moved + delta for moved, delta in zip(self._moved_m, delta_enu_m, strict=True))
        self._moved_m = x, y, z
        self.abandon()

    @property
    def is_measuring(self) -> bool:
        """Whether the flight is measured."""
        return self._begun_ns is not None

    def slide(self, now_ns: int) -> None:
        """Cuts the newest aperture of every neighbour when one is due: each `period_s`, out of the newest `length_m` of
        path; of less path, until one gives a bearing, more often. None is cut while answers are waited for, so that
        none queues up. Reverse channels have `settle_s` to arrive, which nobody stands still for: the aperture ends
        that long ago."""
        if self._begun_ns is None or self._pending:
            return
        blind = max(self._measured_ns.values(), default=0) < self._begun_ns
        period_s = self._config.period_s * (_IMPATIENT if blind and self._was_short else 1.0)
        if now_ns - self._looked_ns < period_s * NS_PER_S:
            return
        end_ns = now_ns - round(self._config.settle_s * NS_PER_S)
        begun_ns = max(self._begun_ns, end_ns - round(_LONGEST_S * NS_PER_S))
        start_ns = self._window.start_of_path(begun_ns, end_ns, self._config.length_m)
        self._was_short = start_ns is None
        if start_ns is None and self._window.path_length_m(begun_ns, end_ns) > _FIRST * self._config.length_m:
            start_ns = begun_ns
        if start_ns is None and begun_ns > self._begun_ns:
            self._begun_ns = start_ns = begun_ns
        if start_ns is not None:
            self._looked_ns = now_ns
            self._cut(start_ns, end_ns)

    def _cut(self, start_ns: int, end_ns: int) -> None:
        self._finished_ns, self._moved_m = self._clock.now_ns(), (0.0, 0.0, 0.0)
        spoiled = self._pose_problem(start_ns, end_ns)
        for neighbour in self._neighbours.values():
            report = self._window.cut(neighbour, start_ns, end_ns)
            if spoiled:
                report = replace(report, aperture=None, refusal=spoiled)
            number, self._number = self._number, self._number + 1
            if report.aperture is None:
                self._end(number, report, AoaResult(id=-1, peer=report.peer, compute_s=0.0))
            else:
                self._recorder.record(APERTURE, report.end_ns, _record_of(number, report, report.aperture))
                self._pending[self._worker.submit(report.peer, report.aperture)] = number, report

    def path_length_m(self) -> float:
        """Path of the antenna that the next aperture can be cut from, by the pose source."""
        if self._begun_ns is None:
            return 0.0
        now_ns = self._clock.now_ns()
        return self._window.path_length_m(max(self._begun_ns, now_ns - round(_LONGEST_S * NS_PER_S)), now_ns)

    @property
    def is_ready(self) -> bool:
        """Whether the worker waits for apertures."""
        return self._worker.ready.is_set()

    def waiting_s(self) -> float:
        """How long results have been waited for; 0 when none are."""
        if not self._pending or self._finished_ns is None:
            return 0.0
        return (self._clock.now_ns() - self._finished_ns) / NS_PER_S

    def take_answer(self, result: AoaResult) -> None:
        """The worker has answered."""
        with self._clock.event() as now_ns:
            failure = result.refusal if result.failed else ""
            self._recorder.record(
                ANSWER,
                now_ns,
                Answer(t_mono_ns=now_ns, id=result.id, peer=result.peer, compute_s=result.compute_s, failure=failure),
            )
            number, report = self._pending.pop(result.id)
            self._end(number, report, result)

    def note_worker(self, is_ready: bool) -> None:
        """A worker has begun or ceased to wait for apertures."""
        with self._clock.event() as now_ns:
            self._recorder.record(WORKER, now_ns, WorkerState(now_ns, is_ready))

    def _end(self, number: int, report: ApertureReport, result: AoaResult) -> None:
        iteration = self._iteration(number, report, result)
        doubt = self._lookalikes.add(iteration.peer, iteration.start_ns, iteration.end_ns, result.profile)
        if doubt:
            iteration = replace(iteration, estimate=None, refusal=doubt)
        if iteration.bearing() is not None:
            # Packets of an aperture that gave none are news to the next one.
            self._measured_ns[iteration.peer] = iteration.end_ns
        self._recorder.record(BEARING, iteration.reference_ns, iteration)
        if result.profile:
            self._recorder.record(PROFILE, iteration.reference_ns, result.profile)
        self.iterations.give(iteration)

    def _iteration(self, number: int, report: ApertureReport, result: AoaResult) -> Iteration:
        seen_ns = min(report.end_ns, max(report.start_ns, self._measured_ns.get(report.peer, 0)))
        reference_ns, peer_p_enu_m = report.end_ns, None
        if result.estimate is not None:
            reference_ns = report.start_ns + round(result.estimate.reference_t_s * NS_PER_S)
            peer_p_enu_m = report.peer_at(reference_ns)
        return Iteration(
            number=number,
            peer=report.peer,
            start_ns=report.start_ns,
            end_ns=report.end_ns,
            fresh=(report.end_ns - seen_ns) / max(1, report.end_ns - report.start_ns),
            reference_ns=reference_ns,
            p_local_enu_m=self._local_position(reference_ns),
            peer_p_enu_m=peer_p_enu_m,
            peer_boot=report.peer_boot,
            received=report.received,
            power_dbm=report.power_dbm,
            dropped=report.dropped,
            compute_s=result.compute_s,
            estimate=result.estimate,
            refusal=report.refusal or result.refusal,
            informativeness=result.informativeness,
            turn=self._turn(report.end_ns),
        )

    def _turn(self, end_ns: int) -> FrameTurn:
        """What the flight so far shows, since it is measured or the autopilot's position last jumped."""
        if self._begun_ns is None:
            return UNKNOWN
        t_ns, local_m = self._local.between(max(self._begun_ns, end_ns - _TURNED_NS), end_ns)
        if len(t_ns) < 2:
            return UNKNOWN
        jumps = np.flatnonzero(np.linalg.norm(np.diff(local_m, axis=0), axis=1) > _JUMP_M)
        first = int(jumps[-1]) + 1 if len(jumps) else 0
        at_ns = np.arange(t_ns[first], min(end_ns, t_ns[-1]) + 1, _TURN_STEP_NS)
        return frame_turn(
            self._window.body_at(at_ns)[:, :2],
            np.stack([np.interp(at_ns, t_ns, local_m[:, axis]) for axis in range(2)], axis=1),
            self._drift,
        )

    def _local_position(self, t_ns: int) -> Vector3 | None:
        """Where the vehicle was, in the frame of now: `t_ns` is before the frame was set anew."""
        times, rows = self._local.between(t_ns, t_ns)
        if not len(times):
            return None
        x, y, z = (float(np.interp(t_ns, times, rows[:, axis])) + self._moved_m[axis] for axis in range(3))
        return x, y, z


def _record_of(number: int, report: ApertureReport, aperture: Aperture) -> ApertureRecord:
    return ApertureRecord(
        number=number,
        peer=report.peer,
        start_ns=report.start_ns,
        end_ns=report.end_ns,
        t_s=aperture.t_s.tobytes(),
        chi_m=aperture.chi_m.tobytes(),
        channel=aperture.channel.tobytes(),
        wavelength_m=aperture.wavelength_m,
        reference_p_m=aperture.reference_p_m,
    )
