"""Every command over what no command expects: one line and an exit code of 0, 1 or 2, never a traceback."""

from __future__ import annotations

import json
import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import pytest

from companion import cli
from companion.cli import main
from companion.core.streams import STREAMS
from companion.log.reader import open_session
from companion.log.writer import LogWriter
from tests.golden.golden_logs import GOLDEN
from tests.paths import CONFIGS

_BYTES: Final = GOLDEN[0].read_bytes()
_METADATA: Final = dict(open_session(GOLDEN[0]).metadata)
_MOST_LINES: Final = 60
_HANGS_S: Final = 300
_ABSENT: Final = "absent.sock"


def _random(path: Path) -> None:
    path.write_bytes(random.Random(1).randbytes(5000))


def _log(path: Path, metadata: Mapping[str, str], data: bytes | None = None) -> None:
    """A log of this program whose every message is `data`."""
    with path.open("wb") as file:
        writer = LogWriter(file, metadata)
        for number, stream in enumerate(STREAMS if data is not None else ()):
            assert data is not None
            writer.copy(stream.topic, stream.encoding, ("", "", b""), (number, number), sequence=number, data=data)
        writer.finish()


def _outlying(path: Path) -> None:
    """The golden flight with a message of 1970 before it and one of the year 2500 behind it."""
    from companion.log.reader import LogScan
    from companion.log.repair import copy

    with path.open("wb") as file:
        writer = LogWriter(file, _METADATA)
        writer.copy("/csi", "raw", ("", "", b""), (1, 1), sequence=0, data=b"\xbb")
        for message in LogScan(GOLDEN[0]):
            copy(writer, message)
        writer.copy("/csi", "raw", ("", "", b""), (1 << 63, 1 << 63), sequence=0, data=b"\xbb")
        writer.finish()


def _pipes(folder: Path) -> None:
    """A recording whose every file is a pipe that nobody writes to."""
    folder.mkdir()
    for name in (
        "csi_rx_2021-07-16_151041.dat", "csi_tx1_2021-07-16_151041.dat", "rx_trajectory_2021-07-16_151041_.csv",
        "groundtruth_positions.json", "csi.dat", "log.mcap",
    ):  # fmt: skip
        os.mkfifo(folder / name)


_MAKERS: Final[dict[str, Callable[[Path], object]]] = {
    "empty": lambda path: path.write_bytes(b""),
    "zeros": lambda path: path.write_bytes(bytes(5000)),
    "random": _random,
    "deep.json": lambda path: path.write_text("[" * 200_000),
    "deep.yaml": lambda path: path.write_text("a: " + "[" * 6000),
    "digits.yaml": lambda path: path.write_text("id: " + "9" * 5000),
    "anchor.yaml": lambda path: path.write_text("a: &a [*a]\n"),
    "latin1.yaml": lambda path: path.write_bytes(b"name: D\xfcsseldorf\n"),
    "twice.yaml": lambda path: path.write_text((CONFIGS / "demo-uav.yaml").read_text() + "\nid: 3\n"),
    "numbers.csv": lambda path: path.write_text("1e400,nan\n,,\n"),
    "folder": lambda path: path.mkdir(),
    "pipe": os.mkfifo,
    "pipe.mcap": os.mkfifo,
    "pipe.csv": os.mkfifo,
    "pipe.yaml": os.mkfifo,
    "pipes": _pipes,
    "endless": lambda path: path.symlink_to("/dev/zero"),
    "terminal": lambda path: path.symlink_to("/dev/ptmx"),
    "loop": lambda path: path.symlink_to(path.name),
    "a[/raw]b].mcap": lambda path: path.write_bytes(_BYTES[:3000]),
    ":boom: [copy].mcap": lambda path: path.write_bytes(_BYTES[:200_000]),
    "cut-head.mcap": lambda path: path.write_bytes(_BYTES[:20]),
    "no-head.mcap": lambda path: path.write_bytes(bytes(512) + _BYTES[512:200_000]),
    "config-deep.mcap": lambda path: _log(path, _METADATA | {"config": "[" * 200_000}),
    "config-list.mcap": lambda path: _log(path, _METADATA | {"config": "[1]"}),
    "config-bad.mcap": lambda path: _log(path, _METADATA | {"config": '{"role": '}),
    "clock-bad.mcap": lambda path: _log(path, _METADATA | {"wall_minus_mono_ns": "1e9"}, b"{}"),
    "part-bad.mcap": lambda path: _log(path, _METADATA | {"part": "x"}),
    "no-message.mcap": lambda path: _log(path, _METADATA),
    "null.mcap": lambda path: _log(path, _METADATA, b"null"),
    "list.mcap": lambda path: _log(path, _METADATA, b"[1]"),
    "object.mcap": lambda path: _log(path, _METADATA, b'{"t_mono_ns": 1e300}'),
    "bytes.mcap": lambda path: _log(path, _METADATA, bytes(range(256))),
    "recording.mcap": lambda path: _log(path, {"role": "recording", "name": "x"}, b"\xff"),
    "outlying.mcap": _outlying,
}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hostile")
    for name, make in _MAKERS.items():
        (folder / name).parent.mkdir(exist_ok=True)
        make(folder / name)
    with (folder / os.fsdecode(b"n\xe4me.mcap")).open("wb") as file:
        file.write(_BYTES[:100_000])
    return folder


_DRAWN: Final = ("no-message.mcap",)
"""An empty log, whose pictures are drawn; what is left of a damaged one is drawn as that of a whole one."""
_ELSEWHERE: Final = (
    ("replay", "outlying.mcap"),  # a whole flight again, which the golden logs replay
    ("report", "outlying.mcap"),  # a test of its own reports it, and looks at the page
)
_CASES: Final = [*_MAKERS, os.fsdecode(b"n\xe4me.mcap"), "n" * 300, "absent", "folder/absent/absent"]

_COMMANDS: Final[dict[str, list[list[str]]]] = {
    "run": [["--config", "{}"]],
    "engage": [["--socket", "{}"]],
    "abort": [["--socket", "{}"]],
    "status": [["--socket", "{}"]],
    "feed": [["{}", "--unix", _ABSENT]],
    "csi": [["{}"]],
    "keygen": [["{}"]],
    "config": [["check", "{}"], ["show", "{}"], ["units", "{}"], ["schema", "--since", "{}"]],
    "radio": [["--config", "{}", "--dry-run"]],
    "doctor": [["radio", "--config", "{}"]],
    "check-axes": [["--config", "{}"]],
    "demo": [],
    "analyze": [["{}", "--no-pictures"], ["--rx", "{}", "--tx", "{}", "--traj", "{}", "--channel", "108"]],
    "evaluate": [["{}"]],
    "study": [],
    "log": [
        ["info", "{}"],
        ["repair", "{}", "--out", "{out}/saved.mcap"],
        ["export", "{}", "--out", "{out}/export"],
        ["merge", "{}", str(GOLDEN[0]), "--out", "{out}/merged.mcap"],
        ["merge", str(GOLDEN[0]), "{}", "--out", "{out}/merged.mcap"],
        ["merge", str(GOLDEN[0]), "--ulg", "{}", "--out", "{out}/merged.mcap"],
        ["import", "{}", "--out", "{out}/imported"],
    ],
    "replay": [["{}"], [str(GOLDEN[0]), "--config", "{}"]],
    "report": [["{}", "-o", "{out}/report.html"]],
}
"""With an input in the place of {}; `demo` and `study` read none, and are given outputs that cannot be."""

_OUTPUTS: Final = [
    ["demo", "--out", "{file}"],
    ["demo", "--json", "{file}/x", "--out", "{out}/demo"],
    ["study", "crb", "--out", "{file}", "--trials", "1"],
    ["doctor", "radio", "--config", "{config}", "--json", "{file}/x"],
    ["keygen", "{file}/x"],
    ["log", "info", "{log}", "--json", "{file}/x"],
    ["log", "repair", "{log}", "--out", "{file}/x"],
    ["log", "repair", "{log}", "--out", "{long}"],
    ["log", "export", "{log}", "--out", "{file}"],
    ["log", "merge", "{log}", "{log}", "--out", "{file}/x"],
    ["log", "import", "{out}", "--out", "{file}"],
    ["replay", "{log}", "--out", "{file}"],
    ["replay", "{log}", "--json", "{out}"],
    ["report", "{log}", "-o", "{file}/x"],
    ["report", "{log}", "-o", "{long}"],
    ["report", "{log}", "-o", "{out}"],
    ["demo", "--json", "{pipe}", "--out", "{out}/demo"],
    ["demo", "--out", "{pipe}"],
    ["study", "crb", "--json", "{pipe}", "--trials", "1", "--out", "{out}/demo"],
    ["doctor", "radio", "--config", "{config}", "--json", "{pipe}"],
    ["keygen", "{pipe}"],
    ["log", "info", "{log}", "--json", "{pipe}"],
    ["log", "repair", "{log}", "--out", "{pipe}"],
    ["log", "export", "{log}", "--out", "{pipe}"],
    ["log", "merge", "{log}", "{log}", "--out", "{pipe}"],
    ["replay", "{log}", "--json", "{pipe}"],
    ["report", "{log}", "-o", "{pipe}"],
]


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Callable[..., Any]:
    """Runs a command in this process, in an empty folder; its exit code and what it said of an error."""

    def run(*arguments: str) -> tuple[int, str]:
        signal.alarm(_HANGS_S)  # ends the whole run: whoever waits for a pipe waits in the kernel
        monkeypatch.setattr(sys, "argv", ["companion", *arguments])
        monkeypatch.chdir(tmp_path)
        with pytest.raises(SystemExit) as ended:
            main()
        signal.alarm(0)
        assert isinstance(ended.value.code, int)
        return ended.value.code, capsys.readouterr().err

    return run


def _argument_lists() -> Iterator[tuple[str, list[str]]]:
    for command, lists in _COMMANDS.items():
        for arguments in lists:
            yield command, arguments


def test_every_command_is_here() -> None:
    assert set(_COMMANDS) == set(cli._COMMANDS)
    assert {command for command, lists in _COMMANDS.items() if not lists} <= {arguments[0] for arguments in _OUTPUTS}


@pytest.mark.parametrize(("command", "arguments"), list(_argument_lists()), ids=lambda value: "-".join(value)[:40])
def test_what_cannot_be_read_is_told_in_words(
    call: Callable[..., tuple[int, str]],
    inputs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    arguments: list[str],
) -> None:
    """One test for all inputs of a command: a thousand tests of their own would cost as much again to begin and end."""
    monkeypatch.setattr("companion.commands.feed._PATIENCE_S", 0.0)
    wrong = {}
    for number, case in enumerate(_CASES):
        if (command, case) in _ELSEWHERE:
            continue
        out = tmp_path / str(number)
        out.mkdir()
        # `keygen` would make what is absent.
        path = (out if command == "keygen" and case in ("absent", "n" * 300) else inputs) / case
        with monkeypatch.context() as patch:
            if command == "report" and case not in _DRAWN:
                patch.setattr("companion.report.pictures._png", lambda figure: b"")
            code, err = call(command, *(one.format(path, out=out) for one in arguments))
        wrong[ascii(case)[:40]] = _wrong(code, err, {one.name for one in out.iterdir()})
    assert {case: found for case, found in wrong.items() if found} == {}
    assert [path.name for path in tmp_path.iterdir() if path.name.endswith(".part")] == []


def _wrong(code: int, err: str, left: set[str]) -> list[str]:
    """What a command did that none may do: its exit code, what it said, and what it left in its folder."""
    found = {
        f"exit code {code}": code not in (0, 1, 2),
        f"a traceback: {err}": "Traceback" in err,
        f"{len(err.splitlines())} lines": len(err.splitlines()) > _MOST_LINES,
        "an exit code without a word": code != 0 and not err.strip(),
        f"half of a result was left: {left}": code != 0 and bool({"saved.mcap", "merged.mcap", "export"} & left),
        f"a part was left: {left}": any(name.endswith(".part") for name in left),
    }
    return [what for what, is_so in found.items() if is_so]


@pytest.mark.parametrize("arguments", _OUTPUTS, ids=lambda value: "-".join(value)[:50])
def test_what_cannot_be_written_is_told_in_one_line(
    call: Callable[..., tuple[int, str]], tmp_path: Path, arguments: list[str]
) -> None:
    (tmp_path / "file").write_text("a file")
    shutil.copy(GOLDEN[0], tmp_path / "log.mcap")
    os.mkfifo(tmp_path / "pipe")
    places = {
        "pipe": tmp_path / "pipe", "file": tmp_path / "file", "out": tmp_path, "log": tmp_path / "log.mcap",
        "long": tmp_path / ("n" * 300), "config": CONFIGS / "demo-uav.yaml",
    }  # fmt: skip
    code, err = call(*(one.format(**places) for one in arguments))
    assert code in (1, 2)
    assert "Traceback" not in err
    assert len(err.strip().splitlines()) <= (4 if "Usage:" in err else 3)
    assert (tmp_path / "file").read_text() == "a file"
    assert {one.name for one in tmp_path.iterdir()} <= {"file", "log.mcap", "demo", "pipe"}


def test_names_are_shown_as_they_are(
    call: Callable[..., tuple[int, str]], inputs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []
    monkeypatch.setattr("rich.console.Console.print", lambda self, text, **_: shown.append(str(text)))
    assert call("log", "info", str(inputs / ":boom: [copy].mcap"))[0] == 0
    assert ":boom: [copy].mcap" in shown[0]


def test_only_one_module_makes_a_console() -> None:
    """Any other would take names for markup."""
    folder = Path(cli.__file__).parent / "commands"
    makers = {path.name for path in folder.glob("*.py") if "import rich.console" in path.read_text() or
              "from rich.console" in path.read_text()}  # fmt: skip
    assert makers == {"terminal.py"}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_standard_output_is_told_in_one_line() -> None:
    import subprocess

    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "companion", "log", "info", str(GOLDEN[0])],
            stdout=full, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    assert done.returncode == 1
    (told,) = done.stderr.strip().splitlines()
    assert told == "companion: standard output: No space left on device"


def test_a_name_commands_no_terminal(call: Callable[..., tuple[int, str]], tmp_path: Path) -> None:
    code, err = call("log", "info", str(tmp_path / "a\x1b[31m\rb"))
    assert code == 1 and "a\\x1b[31m\\x0db: cannot read the log" in err and "\x1b" not in err


@pytest.mark.parametrize("words", [("analyze", ""), ("log", "export", "x.mcap", "--out", ""), ("keygen", "", "a")])
def test_an_empty_word_is_not_the_folder_we_are_in(
    call: Callable[..., tuple[int, str]], words: tuple[str, ...]
) -> None:
    assert call(*words) == (2, "companion: an empty argument; expected a value: is a variable of the shell not set?\n")


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (("engage", "--target", "a", "--target=b"), "--target"),
        (("analyze", "--traj", "a.csv", "--rx", "r", "--traj", "b.csv"), "--traj"),
        (("analyze", "--lever", "1", "2", "3", "--lever", "1", "2", "3", "x"), "--lever"),
        (("log", "export", "x.mcap", "--out", "a", "--to", "tum", "--to", "csv", "--out", "b"), "--out"),
        (("report", "-o", "a", "--out", "b", "x.mcap"), "--out"),
    ],
)
def test_an_option_that_stands_twice_is_refused_and_not_taken_from_the_last(
    call: Callable[..., tuple[int, str]], words: tuple[str, ...], option: str
) -> None:
    code, err = call(*words)
    assert code == 2 and f"Error: {option} is given twice; expected once" in err


def test_a_folder_that_is_a_file_is_said_to_be(call: Callable[..., tuple[int, str]], tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    code, err = call("log", "export", str(GOLDEN[0]), "--out", str(tmp_path / "out"))
    assert code == 1 and "out: cannot be written: no folder; expected one" in err


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
@pytest.mark.parametrize(("words", "code"), [("--help", 0), ("csi /absent", 1)])
def test_streams_that_were_closed_before_the_start_are_done_without(words: str, code: int, closed: str) -> None:
    command = f"{shlex.quote(sys.executable)} -m companion {words} {closed}"
    done = subprocess.run(["/bin/sh", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == code, done
    assert "Traceback" not in done.stderr + done.stdout


def test_what_is_opened_never_has_the_number_of_a_stream(tmp_path: Path) -> None:
    program = f"""
import os, sys
from companion import cli
for number in (0, 1, 2): os.close(number)
sys.stdout = sys.stderr = None
cli._have_streams()
file = open({str(tmp_path / "log")!r}, "w")
print("lost")
file.write(str(file.fileno()))
"""
    subprocess.run([sys.executable, "-c", program], check=True)
    assert int((tmp_path / "log").read_text()) > 2


@pytest.mark.long
def test_a_message_of_another_century_costs_a_report_no_memory(
    call: Callable[..., tuple[int, str]], inputs: Path, tmp_path: Path
) -> None:
    code, err = call("report", str(inputs / "outlying.mcap"), "-o", str(tmp_path / "r.html"), "--json", "n.json")
    assert code == 0, err
    assert "2 messages of another time" in (tmp_path / "r.html").read_text()
    assert json.loads((tmp_path / "n.json").read_text())


def test_home_is_meant_by_a_tilde(
    call: Callable[..., tuple[int, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert call("log", "info", str(GOLDEN[0]), "--json=~/info.json")[0] == 0
    assert (tmp_path / "info.json").exists()
    assert not (tmp_path / "~").exists()
