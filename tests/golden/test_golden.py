"""Golden logs guard behaviour: the code decides on them as it did, byte for byte the same each time, until renewed."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.core.streams import APERTURE
from companion.log.reader import LoggedMessage, Session, open_session
from companion.replay.check import check
from companion.replay.player import DECISION_TOPICS, INPUT_TOPICS, Player
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


class _Beginning(Session):
    """A golden log until its fourth aperture, which holds all that another configuration decides at first."""

    def messages(self, *asked: object, **others: object) -> Iterator[LoggedMessage]:
        apertures = 0
        for message in super().messages(INPUT_TOPICS | DECISION_TOPICS):
            apertures += message.topic == APERTURE.topic
            if apertures == 4:
                return
            yield message


def test_another_decision_is_seen(golden: tuple[Path, ReplayResult]) -> None:
    """What the guard is worth: slightly longer legs are other set points, and other apertures; the same are none."""
    path, whole = golden
    full = open_session(path)
    session = _Beginning(**{one.name: getattr(full, one.name) for one in dataclasses.fields(full)})
    config = session.config()
    longer = dataclasses.replace(config, aperture=dataclasses.replace(config.aperture, length_m=1.25))
    with Player(session, longer, exact=True) as player:
        other = replay_log(player, session, None)
    same = [one for one in whole.decided if one.event <= other.recorded[-1].sequence]
    assert {one.topic for one in check(other.recorded, same, 0) if one.difference is not None} == set()
    differing = {one.topic for one in check(other.recorded, other.decided, 0) if one.difference is not None}
    assert {"/setpoint", "/aperture"} <= differing


def test_a_second_replay_by_the_command_is_the_same_to_the_byte_and_says_so(
    golden: tuple[Path, ReplayResult], tmp_path: Path
) -> None:
    path, first = golden
    command = [
        sys.executable,
        "-m",
        "companion",
        "replay",
        str(path),
        "--check",
        "--json",
        str(tmp_path / "result.json"),
    ]
    done = subprocess.run([*command, "--out", str(tmp_path / "out")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "identical within the tolerances" in done.stdout
    assert json.loads((tmp_path / "result.json").read_text())["sha256"] == first.as_json()["sha256"]
    session = open_session(path)
    write_log(tmp_path / "first.mcap", session, session.config(), first)
    assert (tmp_path / "out" / "replay.mcap").read_bytes() == (tmp_path / "first.mcap").read_bytes()
