"""When the reports of a recorded AX card are due, and that its log is known by what it holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.records import HEADER_BYTES
from csi_bridge.replay import read_tape
from tests.feit_records import record

STEP_US = 10_000
HOST_US = 1_700_000_000_000_000


def log(*, host_step_us: int | None) -> bytes:
    """Twenty reports 10 ms apart; the host's clock, if there is one, is set by so much before the eleventh."""
    reports = []
    for number in range(20):
        report = record(seed=number, stamp_us=number * STEP_US)
        if host_step_us is not None:
            report = replace(report, host_time_us=HOST_US + number * STEP_US + host_step_us * (number >= 10))
        reports.append(encode_record(report))
    return b"".join(reports)


@pytest.mark.parametrize("host_step_us", [None, 0, 30_000_000, -30_000_000])
def test_reports_are_due_by_the_cards_clock(host_step_us: int | None, tmp_path: Path) -> None:
    (tmp_path / "log").write_bytes(log(host_step_us=host_step_us))
    tape = read_tape(tmp_path / "log")
    assert tape.is_feitcsi and tape.is_wall_time == (host_step_us is not None)
    np.testing.assert_allclose(tape.due_s, np.arange(20) * STEP_US * 1e-6, atol=STEP_US * 1e-6 + 1e-6)
    assert np.all(np.diff(tape.t_s) >= 0)


def test_damage_at_the_beginning_does_not_hide_a_log(tmp_path: Path) -> None:
    data = log(host_step_us=None)
    (tmp_path / "log").write_bytes(bytes(HEADER_BYTES) + data[HEADER_BYTES:])
    tape = read_tape(tmp_path / "log")
    assert tape.is_feitcsi and len(tape.records) == 19
