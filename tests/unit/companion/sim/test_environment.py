"""The world ahead of time: as far as its lag behind the vehicle lets it know, and each thing with the time it is of."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from companion.sim import truth
from companion.sim.environment import Sample, World
from companion.sim.stage import Card, set_stage
from tests.vehicle_truth import vehicle_truth

_START_NS = 5_000_000_000
_STEP_NS = 10_000_000


def _state(t_mono_ns: int) -> truth.VehicleTruth:
    return vehicle_truth(t_mono_ns, ((t_mono_ns - _START_NS) * 1e-9, 0.0, 1.0), (1.0, 0.0, 0.0))


@pytest.mark.parametrize("card", ["5300", "ax210"])
def test_everything_is_made_before_its_time_and_once(card: Card, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    scenario = set_stage(tmp_path / "run", tmp_path, 3, use_netlink=False, card=card).scenario
    world = World(scenario, wall_minus_mono_ns=0)
    assert not world.is_known(_START_NS) and world.advance(_START_NS) is None, "nobody flies yet"
    samples: list[Sample] = []
    for now_ns in range(_START_NS, _START_NS + 2_000_000_000, _STEP_NS):
        world.hear(_state(now_ns))
        if world.is_known(now_ns):
            continue
        sample = world.advance(now_ns)
        if sample is not None:
            samples.append(sample)
            assert world.is_known(now_ns + _STEP_NS)
    lag_ns = round(scenario.lag_s * 1e9)
    assert len(samples) == pytest.approx(2_000_000_000 / (lag_ns + _STEP_NS), rel=0.35), "not at every step"
    for records, times_ns in (
        ([r for s in samples for r in s.csi_uav], [t for s in samples for t in s.csi_uav_ns]),
        ([r for s in samples for r in s.csi_beacon], [t for s in samples for t in s.csi_beacon_ns]),
    ):
        assert len(records) == len(times_ns) > 100 and times_ns == sorted(times_ns)
        # A card's clock runs as time does, but for its own parts in a million.
        since_us = [(r.timestamp_low_us - records[0].timestamp_low_us) % (1 << 32) for r in records]
        assert since_us == pytest.approx([(t - times_ns[0]) / 1000 for t in times_ns], abs=10.0)
    for poses_ns in (
        [p.t_mono_ns for s in samples for p in s.poses_uav],
        [p.t_mono_ns for s in samples for p in s.poses_beacon],
    ):
        assert {b - a for a, b in pairwise(poses_ns)} == {5_000_000}


def test_a_vehicle_that_fell_silent_stays_where_it_was(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    world = World(set_stage(tmp_path / "run", tmp_path, 3, use_netlink=False).scenario, wall_minus_mono_ns=0)
    world.hear(_state(_START_NS))
    assert world.advance(_START_NS + 200_000_000) is None, "it may only be late"
    sample = world.advance(_START_NS + 400_000_000)
    assert sample is not None and sample.csi_uav and sample.poses_uav
    assert world.is_known(_START_NS + 399_000_000) and not world.is_known(_START_NS + 401_000_000)
