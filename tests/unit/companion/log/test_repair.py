"""`companion log repair`, and what damage costs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from companion.errors import CompanionError
from companion.log.reader import LogScan, open_session
from companion.log.repair import copy, repair
from companion.log.writer import LogWriter
from tests.log_commands import FLIGHT, Run
from tests.unit.companion.log.written import foreign, log_of


def test_repair_makes_a_cut_log_whole_and_replayable(companion: Run, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(FLIGHT.read_bytes()[:700_000])
    assert companion("log", "repair", cut)[0] == 0
    saved = tmp_path / "cut.repaired.mcap"
    scan = LogScan(saved)
    messages = [message.data for message in scan]
    assert scan.is_whole
    assert messages == [message.data for message in LogScan(cut)]
    assert open_session(saved).config() == open_session(FLIGHT).config()
    code, _, err = companion("log", "repair", cut)
    assert code == 1
    assert "is there already" in err


@pytest.mark.parametrize("zeroed", [pytest.param(1, marks=pytest.mark.long), 4096])
def test_damage_costs_what_it_touched_and_a_replay_ends_before_it(companion: Run, tmp_path: Path, zeroed: int) -> None:
    content = bytearray(FLIGHT.read_bytes())
    middle = len(content) // 2
    content[middle : middle + zeroed] = bytes(byte ^ 0x55 for byte in content[middle : middle + zeroed])
    hurt = tmp_path / "hurt.mcap"
    hurt.write_bytes(content)
    messages, all_messages = list(LogScan(hurt)), list(LogScan(FLIGHT))
    assert 0.7 * len(all_messages) < len(messages) < len(all_messages)
    assert messages[-1] == all_messages[-1]
    code, out, err = companion("log", "info", hurt)
    assert code == 0, err
    assert "DAMAGED at 1 places" in out
    code, out, err = companion("log", "repair", hurt)
    assert code == 0, err
    assert f"{len(messages)} messages" in out
    assert "will differ" in err
    code, out, err = companion("replay", hurt, "--check")
    assert code == 0, out + err
    assert "cut off or damaged" in out
    # Behind the damage other inputs were heard: what differs is told in a line, not in all its numbers.
    code, out, _ = companion("replay", tmp_path / "hurt.repaired.mcap", "--check", "--json", tmp_path / "check.json")
    assert code == 1
    told = [one["difference"] for one in json.loads((tmp_path / "check.json").read_text())["check"]]
    assert any(told)
    assert all(len(one["what"]) < 500 for one in told if one is not None)


@pytest.mark.parametrize("removed", [0, 50])
def test_a_damaged_first_chunk_costs_no_channel_of_the_others(tmp_path: Path, removed: int) -> None:
    """Channels are told once, in the first chunk, and again at the end, wherever that has moved to."""
    content = bytearray(FLIGHT.read_bytes())
    at = content.index(b"\x04\0\0\0zstd") + 200  # not the word in the configuration
    content[at] ^= 0x55
    del content[at + 1 : at + 1 + removed]
    hurt = tmp_path / "hurt.mcap"
    hurt.write_bytes(content)
    assert {message.topic for message in LogScan(hurt)} >= {"/csi", "/pose/in", "/tick", "/vehicle", "/setpoint"}


@pytest.mark.parametrize("removed", [0, 50])
def test_a_damaged_first_chunk_of_a_log_that_was_cut_costs_that_chunk(tmp_path: Path, removed: int) -> None:
    """Without an index: channels are told once more behind the second chunk."""
    log = tmp_path / "log.mcap"
    with log.open("wb") as file:
        writer = LogWriter(file, dict(open_session(FLIGHT).metadata))
        first_chunk = 0
        for message in LogScan(FLIGHT):
            copy(writer, message)
            first_chunk += writer.chunks == 0
    content = bytearray(log.read_bytes()[:400_000])
    log.write_bytes(content)
    unhurt = list(LogScan(log))
    at = content.index(b"\x04\0\0\0zstd") + 200  # not the word in the configuration
    content[at] ^= 0x55
    del content[at + 1 : at + 1 + removed]
    log.write_bytes(content)
    assert list(LogScan(log)) == unhurt[first_chunk + 1 :]
    assert len(unhurt) > 3 * first_chunk


def test_repair_refuses_what_another_program_wrote(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(foreign(True))
    with pytest.raises(CompanionError, match="no log of this program"):
        repair(path, tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_a_failed_repair_leaves_no_target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(log_of(100))

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("companion.log.repair.copy", fail)
    with pytest.raises(CompanionError, match="No space left"):
        repair(path, tmp_path / "out.mcap")
    assert list(tmp_path.iterdir()) == [path]
