"""analyze, evaluate, log import and feed on what nobody would give them on purpose: one line, exit 1, nothing left."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from companion.cli import main
from tests.csi_bytes import changed, wide
from tests.paths import ROOT
from tests.synthetic_run import STAMP, RunFolder

LONG = "n" * 300


@dataclass(frozen=True)
class Done:
    returncode: int
    stdout: bytes
    stderr: bytes


Companion = Callable[..., Done]


@pytest.fixture
def companion(monkeypatch: pytest.MonkeyPatch, capsysbinary: pytest.CaptureFixture[bytes]) -> Companion:
    """The program in this process."""

    def run_it(*arguments: str | Path) -> Done:
        monkeypatch.setattr(sys, "argv", ["companion", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_:
            main()
        captured = capsysbinary.readouterr()
        code = exit_.value.code or 0
        assert isinstance(code, int)
        return Done(code, captured.out, captured.err)

    return run_it


def in_its_own_process(command: list[str], stdout: int = subprocess.PIPE) -> Done:
    done = subprocess.run(
        command, stdout=stdout, stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=False
    )
    return Done(done.returncode, done.stdout or b"", done.stderr)


def one_line(done: Done, *named: str, code: int = 1) -> None:
    assert done.returncode == code, done.stderr
    text = done.stderr.decode(errors="strict")
    assert len(text.strip().splitlines()) == 1 and "Traceback" not in text, text
    for name in named:
        assert name in text


@pytest.mark.parametrize("content", ["[" * 200_000 + "]" * 200_000, "[1]", "3", '{"channel": [108]}', "9" * 5000])
def test_a_truth_that_is_none_is_said_and_not_needed(companion: Companion, run: RunFolder, content: str) -> None:
    run.truth.write_text(content)
    done = companion("analyze", run.folder, "--no-pictures", "--channel", "108")
    assert done.returncode == 0 and done.stderr == b""
    assert done.stdout.count(b"! " + os.fsencode(run.truth)) == 1
    assert companion("log", "import", run.folder, "--out", run.folder / "logs").returncode == 0


def test_a_truth_with_a_byte_order_mark_is_read(companion: Companion, run: RunFolder) -> None:
    run.truth.write_bytes(b"\xef\xbb\xbf" + run.truth.read_bytes())
    done = companion("analyze", run.folder, "--no-pictures")
    assert done.returncode == 0 and b"75.9" in done.stdout and b"!" not in done.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ("analyze", LONG, "--no-pictures"),
        ("evaluate", LONG),
        ("feed", LONG),
        ("log", "import", LONG),
        ("analyze", "--rx", LONG, "--tx", LONG, "--traj", LONG, "--channel", "108", "--no-pictures"),
        ("analyze", f"{LONG}/{LONG}", "--no-pictures"),
    ],
)
def test_a_name_that_is_too_long_is_one_line(companion: Companion, arguments: tuple[str, ...]) -> None:
    one_line(companion(*arguments), "File name too long")


@pytest.mark.parametrize("command", ["analyze", "evaluate"])
def test_places_that_cannot_be_written_leave_nothing(
    companion: Companion, run: RunFolder, tmp_path: Path, command: str
) -> None:
    one_line(companion(command, run.folder, "--out", run.truth), "no folder")
    one_line(companion(command, run.folder, "--out", tmp_path / LONG), "cannot be written")
    one_line(companion(command, run.folder, "--json", tmp_path / LONG), "cannot be written")
    one_line(companion(command, run.folder, "--json", "/dev/full", "--out", tmp_path / "p"), "/dev/full", "No space")
    one_line(companion("log", "import", run.folder, "--out", run.truth), "no folder")
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.long  # of another command in `test_cli.py`
def test_a_full_standard_output_is_one_line(run: RunFolder) -> None:
    full = os.open("/dev/full", os.O_WRONLY)
    command = [sys.executable, "-m", "companion", "analyze", str(run.folder), "--no-pictures"]
    one_line(in_its_own_process(command, full), "No space left on device")
    os.close(full)


def test_names_that_are_no_text_are_written_as_bytes(companion: Companion, run: RunFolder, tmp_path: Path) -> None:
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/s\xe9t/p\xff"))
    folder.parent.mkdir()
    run.folder.rename(folder)
    done = companion("analyze", folder, "--no-pictures", "--json", tmp_path / "a.json")
    assert done.returncode == 0 and rb"s\xe9t/p\xff" in done.stdout
    assert companion("evaluate", folder, "--json", tmp_path / "e.json").returncode == 0
    assert companion("log", "import", folder, "--out", tmp_path / "logs").returncode == 0
    (log,) = (tmp_path / "logs").iterdir()
    assert companion("replay", log).returncode == 0
    assert companion("analyze", folder, "--out", tmp_path / "pictures").returncode == 0
    (folder / f"csi_rx_{STAMP}.dat").unlink()
    one_line(companion("analyze", folder, "--no-pictures"), "is missing")


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to become somebody else")
def test_a_folder_that_may_not_be_listed_is_one_line(companion: Companion, run: RunFolder, tmp_path: Path) -> None:
    code = "import os; os.setuid(65534); import sys; sys.argv = ['companion', *sys.argv[1:]]\n"
    code += "from companion.cli import main; main()"
    for folder in tmp_path.parents:
        if folder.is_relative_to("/tmp/pytest-of-root") or "pytest" in folder.name:
            folder.chmod(folder.stat().st_mode | 0o711)
    tmp_path.chmod(0o711)
    run.folder.chmod(0o711)
    done = in_its_own_process([sys.executable, "-c", code, "analyze", str(run.folder), "--no-pictures"])
    if b"Permission denied" not in done.stderr or b"Traceback" in done.stderr:
        assert b"companion" not in done.stderr.splitlines()[-1], done.stderr
        pytest.skip("the interpreter, or the folder above, may not be read by others here")
    one_line(done, "Permission denied")


def test_channel_6_is_refused_at_every_entrance(companion: Companion, run: RunFolder) -> None:
    named = "channel 6 is a 2.4 GHz channel"
    for command in (("analyze", run.folder, "--no-pictures"), ("log", "import", run.folder)):
        done = companion(*command, "--channel", "6")
        assert done.returncode == 2 and named.encode() in done.stderr
    run.truth.write_text(run.truth.read_text().replace("108", "6"))
    done = companion("analyze", run.folder, "--no-pictures")
    assert done.returncode == 1 and named.encode() in done.stderr
    done = companion("evaluate", run.folder)
    assert named.encode() in done.stdout


def test_records_of_40_mhz_are_left_out_and_counted(companion: Companion, run: RunFolder) -> None:
    run.rx.write_bytes(wide(run.rx.read_bytes(), range(60)))
    run.tx.write_bytes(wide(run.tx.read_bytes(), range(50, 100)))
    done = companion("analyze", run.folder, "--no-pictures")
    assert done.returncode == 0 and b"100 40 MHz" in done.stdout and b"400/500" in done.stdout
    run.tx.write_bytes(wide(run.tx.read_bytes(), range(500)))
    one_line(companion("analyze", run.folder, "--no-pictures"), run.tx.name, "are 40 MHz wide")


def test_csi_that_is_all_zero_is_said_to_be(companion: Companion, run: RunFolder) -> None:
    def zero(number: int, frame: bytearray) -> None:
        frame[3 + 38 :] = bytes(len(frame) - 41)

    for path in (run.tx, run.rx):
        path.write_bytes(changed(path.read_bytes(), zero))
        one_line(companion("analyze", run.folder, "--no-pictures"), path.name, "is zero: the card measured nothing")
