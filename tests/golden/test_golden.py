"""Golden logs guard behaviour: the code decides on them as it did, byte for byte the same each time, until renewed."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import pytest

from companion.log.reader import open_session
from companion.replay.check import check
from companion.replay.player import Player
from companion.replay.result import ReplayResult, replay_log, write_log
from tests.golden.golden_logs import GOLDEN, moved, replayed


@pytest.fixture(scope="module", params=GOLDEN, ids=[path.stem for path in GOLDEN])
def golden(request: pytest.FixtureRequest) -> tuple[Path, ReplayResult]:
    return request.param, replayed(open_session(request.param))


def test_there_are_golden_logs() -> None:
    assert GOLDEN


def test_nothing_has_moved(golden: tuple[Path, ReplayResult]) -> None:
    path, result = golden
    assert len(result.decided) > 200
    for one in moved(open_session(path), result):
        pytest.fail(f"{path.name}: {one.topic}: {one.difference}; if this is meant: make golden")
    assert result.unexpected == 0


def test_a_second_replay_is_the_same_to_the_byte(golden: tuple[Path, ReplayResult], tmp_path: Path) -> None:
    path, first = golden
    session = open_session(path)
    second = replayed(session)
    for name, result in (("one.mcap", first), ("two.mcap", second)):
        write_log(tmp_path / name, session, session.config(), result)
    assert (tmp_path / "one.mcap").read_bytes() == (tmp_path / "two.mcap").read_bytes()
    assert first.as_json() == second.as_json()


def test_another_decision_is_seen(golden: tuple[Path, ReplayResult]) -> None:
    """What the guard is worth: slightly longer legs are other set points, and other apertures."""
    path, result = golden
    session = open_session(path)
    config = session.config()
    longer = dataclasses.replace(config, aperture=dataclasses.replace(config.aperture, length_m=1.25))
    with Player(session, longer, exact=True) as player:
        other = replay_log(player, session, None)
    differing = {one.topic for one in check(result.recorded, other.decided, 0) if one.difference is not None}
    assert {"/setpoint", "/aperture"} <= differing


def test_the_command_checks_and_says_so(golden: tuple[Path, ReplayResult], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "companion", "replay", str(golden[0]), "--check", "--json", str(tmp_path / "j")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "identical within the tolerances" in done.stdout
    assert json.loads((tmp_path / "j").read_text())["sha256"] == golden[1].as_json()["sha256"]
