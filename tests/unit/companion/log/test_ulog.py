"""PX4's own logs, whole and damaged."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from companion.core.streams import VEHICLE
from companion.errors import CompanionError
from companion.log.reader import open_session
from companion.log.ulog import Ulog, clock_offset_s
from tests.golden.golden_logs import GOLDEN
from tests.log_commands import FLIGHT, Run, write_ulog
from tests.ulog_file import ulog_of


def test_a_ulg_that_is_damaged_or_cut_gives_what_can_be_read_or_is_refused(companion: Run, tmp_path: Path) -> None:
    ulg = tmp_path / "flight.ulg"
    write_ulog(ulg, open_session(FLIGHT))
    content = bytearray(ulg.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 300] = bytes(300)
    ulg.write_bytes(content[: len(content) - 1_001])
    code, text, err = companion("log", "merge", FLIGHT, "--ulg", ulg, "--out", tmp_path / "out.mcap")
    assert code == 0, err
    assert "damaged, what could be read" in text
    assert "corruption" not in text  # the parser's own print
    ulg.write_bytes(content[:16] + 10 * b"\1\0F " + b"\x05\0\0")  # the parser alone never ends
    code, _, err = companion("log", "merge", FLIGHT, "--ulg", ulg, "--out", tmp_path / "none.mcap")
    assert code == 1
    assert "not a readable .ulg file: damaged" in err


def test_single_damaged_rows_of_a_ulg_move_nothing_and_are_left_out(companion: Run, tmp_path: Path) -> None:
    ulg = tmp_path / "flight.ulg"
    write_ulog(ulg, open_session(FLIGHT))
    row_s, row_m = Ulog(ulg).positions()
    rows = [(round(1e6 * t), (n, e, -u)) for t, (e, n, u) in zip(row_s.tolist(), row_m.tolist(), strict=True)]
    rows[40] = rows[40][0], (1e38, -1e4, 3.0)
    ulg.write_bytes(
        ulog_of([*rows, (rows[-1][0] + 5_000_000_000, (0, 0, 0)), (1 << 50, (0, 0, 0)), (1 << 63, (0, 0, 0))])
    )
    out = tmp_path / "out.mcap"
    code, text, err = companion("log", "merge", FLIGHT, "--ulg", ulg, "--out", out)
    assert code == 0, err
    assert "positions agree to 0.0" in text
    flight, px4 = (list(open_session(path).messages()) for path in (FLIGHT, out))
    assert px4[-1].log_time_ns <= flight[-1].log_time_ns + 1_000_000_000


@pytest.mark.parametrize(
    ("scale", "part", "why"),
    [
        (0.0, slice(None), "not of this flight"),
        (1.0, slice(0, 40), "m where both logs could agree; 2 m tell"),
        (1.0, slice(0, 3), "it holds positions of 0.1 s, 1 are needed"),
    ],
)
def test_a_ulg_that_could_be_of_any_time_is_refused(
    companion: Run, tmp_path: Path, scale: float, part: slice, why: str
) -> None:
    ulg = tmp_path / "still.ulg"
    write_ulog(ulg, open_session(FLIGHT), scale=scale, part=part)
    code, _, err = companion("log", "merge", FLIGHT, "--ulg", ulg, "--out", tmp_path / "out.mcap")
    assert code == 1
    assert why in err
    assert not (tmp_path / "out.mcap").exists()


GOLDEN_FLIGHT = open_session(GOLDEN[0])


def _track() -> tuple[np.ndarray, np.ndarray]:
    rows = {}
    for message in GOLDEN_FLIGHT.messages({VEHICLE.topic}):
        state = msgspec.json.decode(message.data)
        if state["p_local_enu_m"] is not None:
            rows[state["position_mono_ns"] / 1e9] = state["p_local_enu_m"]
    return np.array(sorted(rows)), np.array([rows[t] for t in sorted(rows)])


@pytest.mark.parametrize("jump_m", [3.0, 4000.0])
def test_a_restart_of_px4_in_the_flight_outweighs_nothing(tmp_path: Path, jump_m: float) -> None:
    """Its log begins anew with each boot, its positions with another origin."""
    t_s, p_m = _track()
    moved = np.cumsum(np.linalg.norm(np.diff(p_m, axis=0), axis=1))
    restart = int(np.searchsorted(moved, 0.35 * moved[-1]))
    shifted = p_m + np.where(np.arange(len(t_s))[:, None] < restart, jump_m, 0.0)
    boot_s = t_s[restart] - 4.0
    ulog = t_s[restart:] - boot_s, p_m[restart:]
    offset_s, rms_m = clock_offset_s(tmp_path / "f.ulg", ulog, (t_s, shifted))
    assert offset_s == pytest.approx(boot_s, abs=0.02)
    assert rms_m < 0.1


def test_a_position_of_time_zero_costs_no_memory(tmp_path: Path) -> None:
    """A grid of tenths of seconds since 1970 would take 140 GB."""
    t_s, p_m = _track()
    wall_s = t_s + 1.7e9
    with_zero = np.concatenate([[0.0], wall_s]), np.concatenate([p_m[:1], p_m])
    offset_s, _ = clock_offset_s(tmp_path / "f.ulg", (t_s, p_m), with_zero)
    assert offset_s == pytest.approx(1.7e9, abs=0.02)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"", "empty file"),
        (b"\x1f\x8b\x08\x00" + bytes(50), "gzip: unpack it first"),
        (b"\xa3\x95\x80\x80" + bytes(50), "a log of ArduPilot"),
        (b"\x89MCAP0\r\n" + bytes(50), "an MCAP log"),
        (b"\x01" * 90, "another file"),
    ],
)
def test_what_is_no_log_of_px4_is_named(tmp_path: Path, content: bytes, named: str) -> None:
    path = tmp_path / "log.ulg"
    path.write_bytes(content)
    with pytest.raises(CompanionError, match=rf"log\.ulg: not a \.ulg file: {named}.*; expected PX4's own log"):
        Ulog(path)
