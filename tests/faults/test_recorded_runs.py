"""Every recording through the live path (feed, connector, netlink source, pairing over real UDP) gives the bearing that
`companion analyze` gives. One run here, another in `unit/companion/analysis/test_imported.py`; all of them by
`make test-long`."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from companion.analysis.runs import Run
from companion.analysis.trajectories import PoseKind
from companion.neighbours.sender import BYTES_PER_S
from tests.csi_records import needs_data
from tests.faults.campaigns import recordings
from tests.faults.figures import record as note
from tests.live_run import run_live, transport

APART_DEG = 0.1


@needs_data
# The last of a set in `make test`: of wsr_3d it is the one in which least adds up coherently.
@pytest.mark.parametrize("run", recordings(first=False))
async def test_fault_00_a_recording_gives_the_same_bearing_live_and_analysed(run: Run, tmp_path: Path) -> None:
    kind = PoseKind.MOCAP if PoseKind.MOCAP in run.trajectories else PoseKind.T265
    links = await run_live(run, kind, tmp_path)
    assert links, "no transmitter of this run could be analysed"
    for link in links:
        assert link.azimuth_rad is not None, f"{link.name}: {link.report.refusal}"
        # Where the trajectory begins and ends, a tenth of a millisecond decides on a packet.
        assert abs(link.packets - link.analysed_packets) <= 2, link.report.dropped
        assert math.degrees(link.azimuth_apart_rad) < APART_DEG
        assert link.level or abs(math.degrees(link.polar_apart_rad)) < APART_DEG
        # The clocks of the recordings are up to 56 s apart; both ends stamp the same exchanges.
        assert link.health["clock_offset_s"] == pytest.approx(link.true_clock_offset_s, abs=2e-3)
        assert link.health["clock_uncertainty_s"] < 5e-3
        assert link.health["pairing_rate"] > 0.75
        # Nothing was left out, and every second of it stayed within the paper's budget.
        assert link.thinned == 0
        assert link.sent_bytes_s < BYTES_PER_S
        # Datagrams of both ways bound the relation of the clocks; here none is on its way for longer than a step.
        assert abs(link.health["round_trip_s"]) < 2e-3
    note(
        0,
        f"live = analysed: {run.set_name} {run.stamp}",
        links=len(links),
        worst_deg=math.degrees(max(link.azimuth_apart_rad for link in links)),
        packets=sum(link.packets for link in links),
        worst_clock_error_ms=1e3 * max(abs(k.health["clock_offset_s"] - k.true_clock_offset_s) for k in links),
        most_bytes_in_a_second=max(link.sent_bytes_s for link in links),
        transport=transport()[0],
    )
