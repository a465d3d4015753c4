"""The truth of a flight: in its log, else beside it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from companion.core.streams import CSI, TRUTH
from companion.log.reader import open_session
from companion.log.records import LoggedIteration
from companion.log.truth import TRUTH_NAME, Truth, write_truth
from companion.log.truths import true_azimuths, truth_of
from companion.log.writer import LogWriter
from tests.unit.companion.log.recorded import CONFIG

_NORTH = Truth(1_000, (0.0, 0.0, 1.0), {CONFIG.peers[0].name: (0.0, 5.0, 1.0)})
_EAST = Truth(2_000, (0.0, 0.0, 1.0), {CONFIG.peers[0].name: (5.0, 0.0, 1.0)})


def _log(path: Path, *truths: Truth) -> Path:
    with path.open("wb") as file:
        writer = LogWriter(file, {"role": "uav", "name": "uav", "config": "{}", "wall_minus_mono_ns": "0"})
        writer.write(CSI, 1, 1, 1, message=b"\xbb")
        for truth in truths:
            writer.write(TRUTH, truth.t_mono_ns, truth.t_mono_ns, 0, message=truth)
        writer.finish()
    return path


def _iteration(peer: int, reference_ns: int) -> LoggedIteration:
    return LoggedIteration(
        number=1, peer=peer, start_ns=0, end_ns=1, reference_ns=reference_ns, received=1, estimate=None, refusal="few"
    )


def test_the_logs_own_truth_comes_before_that_beside_it(tmp_path: Path) -> None:
    write_truth(tmp_path / TRUTH_NAME, [_EAST, Truth(3_000, _EAST.antenna_enu_m, _EAST.peers_enu_m)])
    beside = truth_of(open_session(_log(tmp_path / "log.mcap")))
    assert beside.t_ns.tolist() == [2_000, 3_000]
    own = truth_of(open_session(_log(tmp_path / "own.mcap", _NORTH, _EAST)))
    assert own.t_ns.tolist() == [1_000, 2_000]


def test_without_any_there_is_none(tmp_path: Path) -> None:
    assert not truth_of(open_session(_log(tmp_path / "log.mcap")))


def test_azimuths_are_told_of_peers_and_times_that_it_knows(tmp_path: Path) -> None:
    session = open_session(_log(tmp_path / "log.mcap", _NORTH, _EAST))
    peer = CONFIG.peers[0].id
    iterations = [_iteration(peer, 1_000), _iteration(peer, 2_000), _iteration(peer, 9_000), _iteration(77, 1_000)]
    assert true_azimuths(session, CONFIG, iterations) == pytest.approx({(peer, 1_000): math.pi / 2, (peer, 2_000): 0.0})
