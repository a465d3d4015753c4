"""How the suite is run: every lane's output is printed, one failure fails all, an interrupt ends everything."""

from __future__ import annotations

import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from tests import lanes as suite
from tests.child import child
from tests.lanes import Lane
from tests.paths import ROOT


def _python(name: str, code: str) -> Lane:
    return Lane(name, (sys.executable, "-c", code))


@pytest.fixture(autouse=True)
def _elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(suite, "_OUT", tmp_path)


def test_every_module_of_real_time_is_in_one_lane() -> None:
    words = [ROOT / word for lane in suite.lanes() for word in lane.command if word.startswith("tests/sitl/")]
    for module in (ROOT / "tests/sitl").rglob("test_*.py"):
        assert sum(module.is_relative_to(path) for path in words) == 1, module
    assert all(path.exists() for path in words)


def test_every_module_that_computes_is_in_one_lane() -> None:
    computing, units = (
        [ROOT / word for word in lane.command if word.startswith("tests/")]
        for lane in suite.lanes()
        if lane.name in ("computing", "units")
    )
    ignored = [
        ROOT / word.removeprefix("--ignore=") for lane in suite.lanes() for word in lane.command if "ignore" in word
    ]
    assert [path for path in ignored if path.is_relative_to(ROOT / "tests/unit")] != [] and set(ignored) == set(
        computing
    )
    assert all(path.exists() for path in (*computing, *units))
    rooms = {path.relative_to(ROOT / "tests").parts[0] for path in (ROOT / "tests").rglob("test_*.py")}
    assert {path.relative_to(ROOT / "tests").parts[0] for path in (*computing, *units)} | {"sitl"} == rooms | {"unit"}


def test_all_lanes_run_and_one_that_fails_fails_all(capsys: pytest.CaptureFixture[str]) -> None:
    good, bad = _python("good", "print('said by one')"), _python("bad", "print('by the other'); raise SystemExit(3)")
    assert suite.run([bad, good]) == 1
    printed = capsys.readouterr().out
    assert "said by one" in printed and "by the other" in printed
    assert "bad FAILED (3)" in printed and "good passed" in printed
    assert suite.run([good]) == 0


def test_lanes_that_wait_begin_when_the_kernels_are_compiled(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """And they begin even when that has failed: each says then what is wrong."""
    slow = f"import time; time.sleep(0.3); open({str(tmp_path / 'made')!r}, 'w'); raise SystemExit(1)"
    kernels = Lane("kernels", (sys.executable, "-c", slow))
    seen = Lane("seen", (sys.executable, "-c", f"open({str(tmp_path / 'made')!r})"), waits=True)
    assert suite.run([kernels, seen]) == 1
    assert "seen passed" in capsys.readouterr().out


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_every_lane_and_what_it_started(tmp_path: Path, number: signal.Signals) -> None:
    program = textwrap.dedent(
        f"""
        import signal, sys
        from pathlib import Path
        from tests import lanes as suite
        suite._OUT = Path({str(tmp_path)!r})
        suite.lanes = lambda: [suite.Lane("a", ("sh", "-c", "echo $$; sleep 100 & echo $!; wait"))]
        suite.main()
        """
    )
    # Ignored, as a shell starts what it puts in the background.
    command = ["env", "--ignore-signal=INT", sys.executable, "-c", program]
    output = tmp_path / "a.txt"
    with child(command, cwd=ROOT, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("a:")
        while not output.is_file() or output.read_text().count("\n") < 2:
            assert process.poll() is None
        process.send_signal(number)
        assert "interrupted" in process.stdout.read()
    assert process.returncode == 130
    for pid in output.read_text().split():
        _gone(int(pid))


def _gone(pid: int, within_s: float = 20.0) -> None:
    """What was killed may take its time to go where the machine is busy."""
    deadline_s = time.monotonic() + within_s
    while Path(f"/proc/{pid}/exe").exists():
        assert time.monotonic() < deadline_s, pid
        time.sleep(0.01)
