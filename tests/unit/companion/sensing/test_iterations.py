"""When apertures are cut: as soon as there is enough path for a coarse bearing, then each period out of the newest."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from companion.config.schema import ApertureConfig
from companion.core.clock import NS_PER_S
from companion.core.event_clock import EventClock
from companion.core.messages import Pose
from companion.neighbours.neighbour import Neighbour
from companion.sensing.iterations import SarIterations
from companion.sensing.lookalikes import Lookalikes
from companion.sensing.records import Iteration
from companion.sensing.window import ApertureReport, SarWindow
from companion.sensing.worker_wire import AoaResult
from companion.study.virtual_parts import InlineWorker, NullRecorder
from tests.manual_clock import ManualClock
from tests.unit.companion.flight.known import iteration
from wsr.aperture import Aperture
from wsr.channel import wavelength_m

_SPEED_M_S = 0.5
_CONFIG = ApertureConfig(length_m=1.2, period_s=0.5, settle_s=0.3)


def _measuring(
    window: SarWindow, worker: InlineWorker | _Slow, clock: ManualClock
) -> tuple[SarIterations, list[Iteration]]:
    """Iterations of a neighbour, and where they are found."""
    sar = SarIterations(
        window=window,
        worker=worker,
        neighbours={2: Neighbour(2, "beacon")},
        config=_CONFIG,
        clock=EventClock(clock),
        recorder=NullRecorder(),
        lookalikes=Lookalikes({2: "beacon"}),
        pose_problem=lambda start_ns, end_ns: "",
    )
    found: list[Iteration] = []
    sar.iterations.connect(found.append)
    return sar, found


def _pose(t_ns: int, gone_m: float) -> Pose:
    return Pose(
        t_mono_ns=t_ns,
        p_enu_m=(gone_m, 0.0, 1.0),
        q_enu_from_body=(1.0, 0.0, 0.0, 0.0),
        v_enu_m_s=(_SPEED_M_S, 0.0, 0.0),
        confidence=3,
    )


def _iterations(until_s: float, turned_rad: float = 0.0, jumps_at_s: float = math.inf) -> list[Iteration]:
    """Of a straight flight past a neighbour that nobody hears; the autopilot's frame is turned against the poses."""
    clock = ManualClock(NS_PER_S)
    window = SarWindow(antenna_m=(0.0, 0.0, 0.0), wavelength_m=wavelength_m(108), min_packets=80, max_pose_gap_s=0.05)
    sar, found = _measuring(window, InlineWorker(_CONFIG.estimator, clock), clock)
    begun_ns = clock.now_ns()
    sar.begin()
    while clock.now_ns() < begun_ns + until_s * NS_PER_S:
        clock.advance(0.02)
        now_ns = clock.now_ns()
        gone_m = _SPEED_M_S * (now_ns - begun_ns) / NS_PER_S
        window.add_pose(_pose(now_ns, gone_m))
        jumped_m = 8.0 if now_ns - begun_ns > jumps_at_s * NS_PER_S else 0.0
        along = gone_m * math.cos(turned_rad), gone_m * math.sin(turned_rad) + jumped_m
        sar.add_local_position(now_ns, (*along, 1.0))
        sar.slide(now_ns)
    return found


def test_the_first_apertures_are_shorter_than_those_that_follow_and_sooner_after_each_other() -> None:
    found = _iterations(6.0)
    lengths_m = [_SPEED_M_S * (one.end_ns - one.start_ns) / NS_PER_S for one in found]
    apart_s = [(b.end_ns - a.end_ns) / NS_PER_S for a, b in pairwise(found)]
    assert 0.5 * 1.2 < lengths_m[0] < 0.5 * 1.2 + 0.1, lengths_m
    assert lengths_m[:5] == sorted(lengths_m[:5]), lengths_m
    assert all(abs(length_m - 1.2) < 0.05 for length_m in lengths_m[5:]) and len(lengths_m) > 8, lengths_m
    assert apart_s[0] == pytest.approx(0.25, abs=0.03) and apart_s[-1] == pytest.approx(0.5, abs=0.03), apart_s


def test_nothing_is_cut_from_less() -> None:
    assert _iterations(1.4) == []


def test_a_flight_shows_how_its_poses_are_turned() -> None:
    found = _iterations(20.0, turned_rad=0.2)
    assert 0.0 < found[0].turn.yaw_rad < 0.2
    assert found[-1].turn.yaw_rad == pytest.approx(0.2, abs=0.02)
    assert found[-1].turn.std_rad < 0.5 * found[0].turn.std_rad


def test_what_the_path_showed_before_the_autopilots_position_jumped_counts_no_more() -> None:
    found = _iterations(20.0, turned_rad=0.2, jumps_at_s=12.0)
    assert all(one.turn.yaw_rad < 0.21 for one in found)
    assert found[-1].turn.yaw_rad == pytest.approx(0.2, abs=0.04)


def test_what_apertures_without_a_bearing_saw_is_news_to_the_next_one() -> None:
    found = _iterations(6.0)
    assert found[-1].start_ns < found[-2].end_ns and all(one.bearing() is None for one in found)
    assert [one.fresh for one in found] == [1.0] * len(found)


class _Slow:
    """A worker that has answered nothing yet."""

    def __init__(self) -> None:
        self.ready = asyncio.Event()
        self.asked = 0

    def submit(self, peer: int, aperture: Aperture) -> int:
        self.asked += 1
        return self.asked - 1


class _Heard(SarWindow):
    """Each aperture is one that the worker can be asked about."""

    def cut(self, neighbour: Neighbour, start_ns: int, end_ns: int) -> ApertureReport:
        t_s = np.linspace(0.0, (end_ns - start_ns) / NS_PER_S, 20)
        aperture = Aperture(
            t_s=t_s, chi_m=np.outer(t_s, (1.0, 0.0, 0.0)), channel=np.ones(20, complex), wavelength_m=0.05,
            reference_p_m=(0.0, 0.0, 0.0), reference_t_s=0.0,
        )  # fmt: skip
        return ApertureReport(
            peer=neighbour.id, start_ns=start_ns, end_ns=end_ns, received=20, power_dbm=-50.0, dropped={},
            aperture=aperture, peer_t_s=t_s, peer_p_m=np.zeros((20, 3)), peer_boot=1,
        )  # fmt: skip


@pytest.mark.parametrize("delta_m", [0.0, 8.0])
def test_what_is_computed_while_the_local_frame_is_set_anew_was_seen_from_where_that_place_is_now(
    delta_m: float,
) -> None:
    clock = ManualClock(NS_PER_S)
    window = _Heard(antenna_m=(0.0, 0.0, 0.0), wavelength_m=0.05, min_packets=10, max_pose_gap_s=0.05)
    worker, begun_ns = _Slow(), clock.now_ns()
    sar, found = _measuring(window, worker, clock)

    def fly(offset_m: float) -> None:
        clock.advance(0.02)
        now_ns = clock.now_ns()
        gone_m = _SPEED_M_S * (now_ns - begun_ns) / NS_PER_S
        window.add_pose(_pose(now_ns, gone_m))
        sar.add_local_position(now_ns, (gone_m, offset_m, 1.0))
        sar.slide(now_ns)

    sar.begin()
    while not worker.asked:
        fly(0.0)
    fly(delta_m)
    sar.shift((0.0, delta_m, 0.0))
    sar.begin()
    fly(delta_m)
    estimate = iteration().estimate
    assert estimate is not None
    sar.take_answer(AoaResult(id=0, peer=2, compute_s=0.1, estimate=replace(estimate, reference_t_s=0.5)))
    (one,) = found
    gone_m = _SPEED_M_S * (one.reference_ns - begun_ns) / NS_PER_S
    assert one.p_local_enu_m == pytest.approx((gone_m, delta_m, 1.0))
    while worker.asked < 2:
        fly(delta_m)
    sar.take_answer(AoaResult(id=1, peer=2, compute_s=0.1, estimate=replace(estimate, reference_t_s=0.5)))
    assert found[-1].p_local_enu_m is not None and found[-1].p_local_enu_m[1] == pytest.approx(delta_m)
