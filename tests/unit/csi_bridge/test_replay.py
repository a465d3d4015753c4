"""When a recorded log's records are due: by the card's clock, whatever became of the host's."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from csi_bridge.dat_frames import DatFileError
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.records import HEADER_BYTES
from csi_bridge.replay import Tape, play, read_tape
from tests import csi_records
from tests.csi_bytes import changed, later
from tests.csi_records import log_of
from tests.feit_records import MAC, record
from tests.synthetic_run import TX_MAC, RunFolder

YEARS_S = 53 * 365.25 * 86400
STEP_S = 3.8 / 499


def due_s(run: RunFolder, data: bytes) -> np.ndarray:
    run.rx.write_bytes(data)
    return read_tape(run.rx).due_s


def test_a_tape_is_spaced_as_it_was_recorded(run: RunFolder) -> None:
    tape = read_tape(run.rx)
    np.testing.assert_allclose(tape.due_s, np.arange(500) * STEP_S, atol=1e-5)
    assert tape.t_s[0] > 1e9 and tape.duration_s == pytest.approx(3.8, abs=1e-4)
    assert tape.records[3:5][1] == tape.records[4]


def test_the_senders_of_a_tape_are_those_its_reports_name(run: RunFolder, tmp_path: Path) -> None:
    assert read_tape(run.rx).senders() == {TX_MAC}
    (tmp_path / "ax.csi").write_bytes(encode_record(record()))
    assert read_tape(tmp_path / "ax.csi").senders() == {MAC.hex(":").upper()}
    run.rx.write_bytes(log_of([csi_records.record(layout=20)]))
    assert read_tape(run.rx).senders() == frozenset()


@pytest.mark.parametrize("by_s", [YEARS_S, -YEARS_S + 1e6, -0.4, 30.0])
def test_a_host_clock_that_was_set_makes_nobody_wait(run: RunFolder, by_s: float) -> None:
    np.testing.assert_allclose(due_s(run, later(run.rx.read_bytes(), 100, by_s)), np.arange(500) * STEP_S, atol=0.01)


def test_a_card_that_was_reset_makes_nobody_wait(run: RunFolder) -> None:
    def reset(number: int, frame: bytearray) -> None:
        if number >= 200:
            struct.pack_into("<I", frame, 3, 1000 + round((number - 200) * STEP_S * 1e6))

    np.testing.assert_allclose(
        due_s(run, changed(run.rx.read_bytes(), reset)), np.arange(500) * STEP_S, atol=2 * STEP_S
    )


def test_a_single_wrong_stamp_moves_nothing_behind_it(run: RunFolder) -> None:
    def wrong(number: int, frame: bytearray) -> None:
        if number == 200:
            struct.pack_into("<I", frame, 3, 77)

    np.testing.assert_allclose(
        due_s(run, changed(run.rx.read_bytes(), wrong)), np.arange(500) * STEP_S, atol=2 * STEP_S
    )


class _Taken:
    def __init__(self) -> None:
        self.count = 0

    def send(self, code: int, body: bytes) -> bool:
        self.count += 1
        return True

    def close(self) -> None:
        pass


def test_play_ends_with_the_card_and_not_with_the_wall_clock(run: RunFolder) -> None:
    run.rx.write_bytes(later(run.rx.read_bytes(), 100, YEARS_S))
    tape, taken, now_s = read_tape(run.rx), _Taken(), iter(np.arange(0.0, 1e4, 0.5))
    assert isinstance(tape, Tape)
    assert list(play(tape, taken, 1000.0, lambda: float(next(now_s))))[-1] == (500, 500)
    assert taken.count == 500


FEIT_STEP_US = 10_000
FEIT_HOST_US = 1_700_000_000_000_000


def feit_log(*, host_step_us: int | None) -> bytes:
    """Twenty reports 10 ms apart; the host's clock, if there is one, is set by so much before the eleventh."""
    reports = []
    for number in range(20):
        report = record(seed=number, stamp_us=number * FEIT_STEP_US)
        if host_step_us is not None:
            report = replace(report, host_time_us=FEIT_HOST_US + number * FEIT_STEP_US + host_step_us * (number >= 10))
        reports.append(encode_record(report))
    return b"".join(reports)


@pytest.mark.parametrize("host_step_us", [None, 0, 30_000_000, -30_000_000])
def test_reports_of_an_ax_card_are_due_by_its_clock(host_step_us: int | None, tmp_path: Path) -> None:
    (tmp_path / "log").write_bytes(feit_log(host_step_us=host_step_us))
    tape = read_tape(tmp_path / "log")
    assert tape.is_feitcsi and bool(tape.t_s[0] > 1e9) == (host_step_us is not None)
    np.testing.assert_allclose(tape.due_s, np.arange(20) * FEIT_STEP_US * 1e-6, atol=FEIT_STEP_US * 1e-6 + 1e-6)
    assert np.all(np.diff(tape.t_s) >= 0)


def test_damage_at_the_beginning_does_not_hide_an_ax_cards_log(tmp_path: Path) -> None:
    data = feit_log(host_step_us=None)
    (tmp_path / "log").write_bytes(bytes(HEADER_BYTES) + data[HEADER_BYTES:])
    tape = read_tape(tmp_path / "log")
    assert tape.is_feitcsi and len(tape.records) == 19


def test_an_ax_cards_log_without_a_whole_record_is_named(tmp_path: Path) -> None:
    cut = tmp_path / "cut.csi"
    cut.write_bytes(encode_record(record())[:272])
    with pytest.raises(DatFileError, match=r"cut\.csi: a FeitCSI log without a whole record: 272 bytes of one"):
        read_tape(cut)
