"""Ways in which a recorded run can be wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.synthetic_run import RunFolder


def spoil(run: RunFolder, what: str) -> None:
    match what:
        case "no rx":
            run.rx.unlink()
        case "no tx":
            run.tx.unlink()
        case "no trajectory":
            run.trajectory.unlink()
        case "no truth":
            run.truth.unlink()
        case "empty rx":
            run.rx.write_bytes(b"")
        case "empty tx":
            run.tx.write_bytes(b"")
        case "empty trajectory":
            run.trajectory.write_text("")
        case "rx is text":
            run.rx.write_text("sec,nsec,x,y,z\n" * 300)
        case "tx is text":
            run.tx.write_text("sec,nsec,x,y,z\n" * 300)
        case "trajectory is binary":
            run.trajectory.write_bytes(run.rx.read_bytes())
        case "trajectory has a word":
            run.trajectory.write_text(run.trajectory.read_text().replace("\n", "\nlost,", 1))
        case "trajectory is narrow":
            run.trajectory.write_text("1.0,2.0,3.0\n" * 5)
        case "trajectory is NaN":
            run.trajectory.write_text("1700000000.0,0.0,nan,nan,nan\n" * 500)
        case "trajectory stands still":
            run.trajectory.write_text("".join(f"{1_700_000_000 + n / 100:.6f},0,1,1,1\n" for n in range(500)))
        case "trajectory too early":
            run.trajectory.write_text(run.trajectory.read_text().replace("17000000", "16999990"))
        case "short trajectory":
            run.trajectory.write_text("".join(run.trajectory.read_text().splitlines(keepends=True)[200:208]))
        case "one log twice":
            run.tx.write_bytes(run.rx.read_bytes())
        case "logs swapped":
            at_rx, at_tx = run.rx.read_bytes(), run.tx.read_bytes()
            run.rx.write_bytes(at_tx)
            run.tx.write_bytes(at_rx)
        case "truth is no JSON":
            run.truth.write_text("{")
        case "truth without channel":
            run.truth.write_text("{}")
        case "truth with channel Infinity":
            run.truth.write_text(run.truth.read_text().replace("108", "Infinity"))
        case "truth with a place NaN":
            run.truth.write_text(run.truth.read_text().replace("2.5", "NaN"))
        case "trajectory far out":
            run.trajectory.write_text(run.trajectory.read_text().replace(",-2.000000", ",1e155"))
        case "other run":
            _replace_stamps(run.tx)
        case "counters all twice":
            run.rx.write_bytes(run.rx.read_bytes()[:-40] * 2)
        case _:
            raise AssertionError(what)


def _replace_stamps(path: Path) -> None:
    """The same counters at another pace: 1 % slower on both clocks."""
    records = np.frombuffer(path.read_bytes(), np.uint8).reshape(500, -1).copy()
    late_us = np.arange(500) * 75
    for at, stamps_us in ((3, (4_290_000_000 + np.arange(500) * 7600 + late_us) % 2**32), (27, late_us + 7600)):
        records[:, at : at + 4] = stamps_us.astype("<u4")[:, None].view(np.uint8)
    seconds, microseconds = np.divmod(np.arange(500) * 7600 + late_us, 1_000_000)
    for at, part in ((23, seconds + 1_700_000_500), (27, microseconds)):
        records[:, at : at + 4] = part.astype("<u4")[:, None].view(np.uint8)
    path.write_bytes(records.tobytes())
