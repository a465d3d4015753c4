"""A log of nothing but the truth."""

from __future__ import annotations

import time
from pathlib import Path

import msgspec
import pytest

from companion.core.streams import TRUTH
from companion.errors import CompanionError
from companion.log.reader import LogScan, metadata_of
from companion.log.truth import Truth, write_truth

_TRUTHS = [Truth(n * 10**9, (0.5, 0.0, 1.5), {"ground": (1.0 * n, 2.0, 0.3)}) for n in (1, 2)]


def test_it_is_on_this_hosts_clocks(tmp_path: Path) -> None:
    write_truth(tmp_path / "truth.mcap", _TRUTHS)
    found = list(LogScan(tmp_path / "truth.mcap"))
    assert [msgspec.json.decode(one.data, type=Truth) for one in found] == _TRUTHS
    assert {one.topic for one in found} == {TRUTH.topic}
    offset_ns = int(metadata_of(tmp_path / "truth.mcap")["companion"]["wall_minus_mono_ns"])
    assert [one.log_time_ns - offset_ns for one in found] == [10**9, 2 * 10**9]
    assert abs(offset_ns - (time.time_ns() - time.monotonic_ns())) < 60 * 10**9


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(CompanionError, match=r"nowhere/truth\.mcap: cannot be written: No such file"):
        write_truth(tmp_path / "nowhere" / "truth.mcap", _TRUTHS)
