"""Whether another robot's log is of the same flight: by what it broadcast, and never by counters alone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from companion.errors import CompanionError
from companion.log.merge import merge
from companion.log.reader import open_session
from companion.log.writer import LogWriter
from tests.flight_logs import beacon_log, uav_log
from tests.golden.golden_logs import GOLDEN

GOLDEN_FLIGHT = open_session(GOLDEN[0])


def test_a_beacon_of_another_flight_is_refused_whatever_its_counters(tmp_path: Path) -> None:
    uav = tmp_path / "uav.mcap"
    uav_log(uav, GOLDEN_FLIGHT)
    beacon_log(tmp_path / "beacon.mcap", GOLDEN_FLIGHT, is_other_flight=True)
    with pytest.raises(CompanionError, match=r"not of this flight: .*\(boot 5\), of which 0 are in its own log"):
        merge(uav, [tmp_path / "beacon.mcap"], None, tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_a_robot_that_the_flight_does_not_know_is_refused(tmp_path: Path) -> None:
    config = json.loads(GOLDEN_FLIGHT.metadata["config"]) | {"id": 77, "name": "stranger"}
    with (tmp_path / "other.mcap").open("wb") as file:
        LogWriter(file, {"role": "beacon", "name": "stranger", "config": json.dumps(config)}).finish()
    with pytest.raises(CompanionError, match=r"of robot 77 \(stranger\), which .* knows not: 2 \(beacon\)"):
        merge(GOLDEN[0], [tmp_path / "other.mcap"], None, tmp_path / "out.mcap")
