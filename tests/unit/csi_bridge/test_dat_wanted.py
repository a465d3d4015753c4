"""Of a log only what is wanted is kept, in memory that goes by that and not by the file."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from csi_bridge import dat_frames, dat_wanted
from csi_bridge.dat import read_dat
from csi_bridge.dat_wanted import Wanted
from tests.csi_bytes import later
from tests.synthetic_run import EXCHANGES, START_S, RunFolder, write_run

_READS = """
import resource, sys
from csi_bridge.dat import read_dat
from csi_bridge.dat_wanted import Wanted
read_dat(sys.argv[1])
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
log = read_dat(sys.argv[2], Wanted((float(sys.argv[3]), float(sys.argv[4]))))
print(len(log), log.left_out_count, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


def long_log(run: RunFolder, path: Path, times: int) -> int:
    """The run's log so often, each four seconds after the one before; bytes written."""
    one = np.frombuffer(run.rx.read_bytes(), np.uint8)
    size = (int(one[0]) << 8 | int(one[1])) + 2
    records = one[: EXCHANGES * size].reshape(EXCHANGES, size).copy()
    with path.open("wb") as file:
        for number in range(times):
            seconds = np.frombuffer(records[:, 23:27].tobytes(), "<u4") + (4 if number else 0)
            records[:, 23:27] = seconds.astype("<u4").view(np.uint8).reshape(EXCHANGES, 4)
            file.write(records.tobytes())
    return EXCHANGES * size * times


def test_records_of_a_time_and_of_counters_are_kept(run: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dat_wanted, "_NEIGHBOURS", 50)
    whole = read_dat(run.rx)
    assert whole.left_out_count == 0 and whole.left_out_s is None
    some = read_dat(run.rx, Wanted(counters=(101, 150)))
    assert some.frame_count.tolist() == list(range(101, 151)) and some.left_out_count == 450
    np.testing.assert_array_equal(some.csi, whole.csi[100:150])
    assert some.timestamp_low_us.tolist() == whole.timestamp_low_us[100:150].tolist()
    few = read_dat(run.rx, Wanted((START_S + 0.09, START_S + 0.11)))
    assert 50 <= len(few) <= 102
    assert few.left_out_s == pytest.approx((whole.host_time_s[len(few)], whole.host_time_s[-1]))
    assert len(read_dat(run.rx, Wanted((0.0, 1.0)))) == 0


def test_neighbours_show_a_clock_that_was_set(run: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dat_wanted, "_NEIGHBOURS", 50)
    run.rx.write_bytes(later(run.rx.read_bytes(), 100, 1e6))
    kept = read_dat(run.rx, Wanted((START_S, START_S + 10)))
    assert 150 <= len(kept) <= 200


@pytest.mark.parametrize("wanted", [None, Wanted((START_S + 8, START_S + 12))])
def test_a_mapped_file_is_read_as_one_that_is_read_whole(
    run: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wanted: Wanted | None
) -> None:
    path = tmp_path / "long.dat"
    long_log(run, path, 6)
    path.write_bytes(path.read_bytes()[:100] + b"damage" + path.read_bytes()[100:])
    whole = read_dat(path, wanted)
    monkeypatch.setattr(dat_frames, "_MAPPED_BYTES", 1000)
    mapped = read_dat(path, wanted)
    for name in ("csi", "host_time_s", "mac", "frame_count", "malformed_count", "skipped_bytes", "left_out_count"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(mapped, name))


def test_memory_goes_by_what_is_wanted(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", (3.0, 6.0, 2.5))
    size = long_log(run, tmp_path / "long.dat", 900)
    assert size > 100e6
    arguments = [str(run.rx), str(tmp_path / "long.dat"), str(START_S + 1000), str(START_S + 1004)]
    done = subprocess.run([sys.executable, "-c", _READS, *arguments], capture_output=True, text=True, check=True)
    kept, left_out, grown_kb = map(int, done.stdout.split())
    assert 500 <= kept <= 2500 and kept + left_out == 900 * EXCHANGES
    assert grown_kb < 60_000  # of a hundred megabytes; a few bytes for each record remain
