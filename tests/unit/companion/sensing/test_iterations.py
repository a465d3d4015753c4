"""When apertures are cut: as soon as there is enough path for a coarse bearing, then each period out of the newest."""

from __future__ import annotations

from companion.config.schema import ApertureConfig
from companion.core.clock import NS_PER_S
from companion.core.event_clock import EventClock
from companion.core.messages import Pose
from companion.neighbours.neighbour import Neighbour
from companion.sensing.iterations import SarIterations
from companion.sensing.lookalikes import Lookalikes
from companion.sensing.records import Iteration
from companion.sensing.window import SarWindow
from companion.study.virtual_parts import InlineWorker, NullRecorder
from tests.manual_clock import ManualClock
from wsr.channel import wavelength_m

_SPEED_M_S = 0.5


def _iterations(until_s: float) -> list[Iteration]:
    """Of a straight flight past a neighbour that nobody hears."""
    clock = ManualClock(NS_PER_S)
    window = SarWindow((0.0, 0.0, 0.0), wavelength_m(108), 80, 0.05)
    config = ApertureConfig(length_m=1.2, period_s=0.5, settle_s=0.3)
    sar = SarIterations(
        window=window,
        worker=InlineWorker(config.estimator, clock),
        neighbours={2: Neighbour(2, "beacon")},
        config=config,
        clock=EventClock(clock),
        recorder=NullRecorder(),
        lookalikes=Lookalikes({2: "beacon"}),
        pose_problem=lambda start_ns, end_ns: "",
    )
    found: list[Iteration] = []
    sar.iterations.connect(found.append)
    begun_ns = clock.now_ns()
    sar.begin()
    while clock.now_ns() < begun_ns + until_s * NS_PER_S:
        clock.advance(0.02)
        now_ns = clock.now_ns()
        gone_m = _SPEED_M_S * (now_ns - begun_ns) / NS_PER_S
        window.add_pose(Pose(now_ns, (gone_m, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0), (_SPEED_M_S, 0.0, 0.0), 3))
        sar.slide(now_ns)
    return found


def test_the_first_aperture_is_shorter_than_those_that_follow() -> None:
    lengths_m = [_SPEED_M_S * (one.end_ns - one.start_ns) / NS_PER_S for one in _iterations(6.0)]
    assert 0.6 * 1.2 < lengths_m[0] < 0.6 * 1.2 + 0.3, lengths_m
    assert lengths_m[:3] == sorted(lengths_m[:3]), lengths_m
    assert all(abs(length_m - 1.2) < 0.05 for length_m in lengths_m[3:]) and len(lengths_m) > 6, lengths_m


def test_nothing_is_cut_from_less() -> None:
    assert _iterations(1.6) == []
