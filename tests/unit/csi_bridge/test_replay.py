"""When a recorded log's records are due: by the card's clock, whatever became of the host's."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from csi_bridge.replay import Tape, play, read_tape
from tests.csi_bytes import changed, later
from tests.synthetic_run import RunFolder

YEARS_S = 53 * 365.25 * 86400
STEP_S = 3.8 / 499


def due_s(run: RunFolder, data: bytes) -> np.ndarray:
    run.rx.write_bytes(data)
    return read_tape(run.rx).due_s


def test_a_tape_is_spaced_as_it_was_recorded(run: RunFolder) -> None:
    tape = read_tape(run.rx)
    np.testing.assert_allclose(tape.due_s, np.arange(500) * STEP_S, atol=1e-5)
    assert tape.is_wall_time and tape.duration_s == pytest.approx(3.8, abs=1e-4)
    assert tape.records[3:5][1] == tape.records[4]


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
