"""Starts that fail and services that must end: each says why in one line and is gone within its limit."""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from companion.host.ending import END_LIMIT_S
from tests.child import child
from tests.faults.campaigns import runs
from tests.faults.figures import ROOT, record

_NOBODY = 65534
_START_S = 180.0
"""For the interpreter and its imports on a machine that is busy; the reason comes long before."""
_NO_NETWORK = "neighbours.broadcast 203.0.113.255, port 17650: Cannot assign requested address"
_BESIDE = {"PYTHONPATH": str(ROOT)}


@pytest.fixture
def robot() -> Iterator[Path]:
    """A folder with keys and the shipped configurations, whose directories are within it; any user may use it."""
    with tempfile.TemporaryDirectory(prefix="companion-", dir="/tmp") as name:
        folder = Path(name)
        for key in ("uav.key", "beacon.key"):
            (folder / key).write_bytes(secrets.token_bytes(32))
            (folder / key).chmod(0o600)
        for shipped in (ROOT / "configs").glob("[bu]*.yaml"):
            text = shipped.read_text(encoding="utf-8")
            for there in ("/run/companion", "/var/lib/companion", "/var/log/companion", "/etc/companion"):
                text = text.replace(there, name)
            # Of a network for documents: no host has it.
            (folder / shipped.name).write_text(text.replace("192.168.1.255", "203.0.113.255"), encoding="utf-8")
        yield folder


@contextmanager
def _start(config: Path, module: str = "companion", python: str = sys.executable) -> Iterator[subprocess.Popen[str]]:
    command = [python, "-m", module, *(["run"] if module == "companion" else []), "--config", str(config)]
    pipe = subprocess.PIPE
    with child(command, stdout=pipe, stderr=pipe, cwd=config.parent, env=os.environ | _BESIDE) as process:
        yield process


def _fails(config: Path, python: str = sys.executable) -> str:
    """The lines of a start that fails as it should, without those of the log that say nothing is wrong."""
    with _start(config, python=python) as process:
        out, err = process.communicate(timeout=_START_S)
    assert process.returncode in (1, 2), err
    assert not out
    assert len(err.splitlines()) == 1 and err.startswith("companion: "), err
    return err


@contextmanager
def _manager(robot: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """What systemd hears of a service."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(robot / "notify.sock"))
        manager.settimeout(_START_S)
        monkeypatch.setenv("NOTIFY_SOCKET", str(robot / "notify.sock"))
        yield manager


@pytest.mark.parametrize("name", ["uav", "beacon"])
def test_fault_42_a_start_that_fails_says_why_and_ends(robot: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    count, longest_s = runs(1, 20), 0.0
    with _manager(robot, monkeypatch) as manager:
        for _ in range(count):
            began_s = time.monotonic()
            assert _NO_NETWORK in _fails(robot / f"{name}.yaml")
            longest_s = max(longest_s, time.monotonic() - began_s)
            assert manager.recv(64) == b"STOPPING=1"  # and no READY=1 before it
    record(42, starts=count, longest_s=round(longest_s, 1))


def test_fault_42_a_start_of_an_ordinary_user_ends_as_well(robot: Path) -> None:
    setpriv = shutil.which("setpriv")
    if os.getuid() != 0 or setpriv is None:
        pytest.skip("only root can become another user, and by setpriv")
    if subprocess.run([setpriv, "--reuid", str(_NOBODY), sys.executable, "-c", ""], check=False).returncode:
        pytest.skip("this interpreter is not for other users")
    for path in (robot, *robot.iterdir()):
        os.chown(path, _NOBODY, _NOBODY)
    for _ in range(runs(1, 20)):
        command = [setpriv, "--reuid", str(_NOBODY), "--clear-groups", sys.executable, "-m", "companion", "run"]
        done = subprocess.run(
            [*command, "--config", str(robot / "uav.yaml")],
            capture_output=True,
            text=True,
            timeout=_START_S,
            check=False,
            cwd=robot,
            env=os.environ | _BESIDE | {"PYTHONDONTWRITEBYTECODE": "1"},
        )
        assert done.returncode in (1, 2) and len(done.stderr.splitlines()) == 1, done.stderr


def _interpreters() -> list[str]:
    """Of other versions, with the requirements installed: COMPANION_PYTHONS names them, colons between."""
    return [python for python in os.environ.get("COMPANION_PYTHONS", "").split(":") if python]


@pytest.mark.parametrize("python", _interpreters() or [""])
def test_fault_42_other_interpreters_end_and_say_the_same(robot: Path, python: str) -> None:
    if not python:
        pytest.skip("COMPANION_PYTHONS names no other interpreter")
    compiled = subprocess.run(
        [
            python,
            "-c",
            "import sys, pathlib\nfor p in map(pathlib.Path, sys.argv[1:]): compile(p.read_bytes(), p, 'exec')",
        ]
        + [str(path) for room in ("companion", "wsr", "csi_bridge") for path in (ROOT / room).rglob("*.py")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert compiled.returncode == 0, compiled.stderr
    version = subprocess.run([python, "--version"], capture_output=True, text=True, check=True).stdout.split()[1]
    count, longest_s = runs(1, 20), 0.0
    for name in ("uav", "beacon") * count:
        began_s = time.monotonic()
        assert _NO_NETWORK in _fails(robot / f"{name}.yaml", python)
        longest_s = max(longest_s, time.monotonic() - began_s)
    record(42, f"starts of Python {version}", starts=2 * count, longest_s=round(longest_s, 1))


def _until(path: Path) -> None:
    end_s = time.monotonic() + _START_S
    while not path.exists():
        assert time.monotonic() < end_s, f"{path} was never there"
        time.sleep(0.05)


def _on_loopback(config: Path) -> Path:
    text = config.read_text(encoding="utf-8").replace("203.0.113.255", "127.255.255.255")
    config.write_text(text.replace("source: netlink", "source: unix"), encoding="utf-8")
    return config


_LONG = pytest.mark.long


@pytest.mark.parametrize(
    ("name", "number"),
    [
        # Each role and each signal once: all of them are bound to one handler, and by the same lines for both roles.
        ("uav", signal.SIGTERM),
        ("beacon", signal.SIGINT),
        ("beacon", signal.SIGHUP),
        pytest.param("uav", signal.SIGINT, marks=_LONG),
        pytest.param("uav", signal.SIGHUP, marks=_LONG),
        pytest.param("beacon", signal.SIGTERM, marks=_LONG),
    ],
)
def test_a_signal_ends_a_running_service_with_0(robot: Path, name: str, number: signal.Signals) -> None:
    with _start(_on_loopback(robot / f"{name}.yaml")) as process:
        _until(robot / "control.sock")
        process.send_signal(number)
        _, err = process.communicate(timeout=_START_S)
    assert process.returncode == 0 and "stopped on request" in err and "Traceback" not in err, err
    assert not (robot / "control.sock").exists()


def test_a_signal_ends_a_service_whose_loop_stands_still(robot: Path) -> None:
    with _start(_on_loopback(robot / "uav.yaml"), "tests.faults.service") as process:
        _until(robot / "control.sock")
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as orders:
            orders.sendto(b"block 100", str(robot / "faults.sock"))
        time.sleep(0.5)  # into the block; too early would be a plain end, which the assertion on the code shows
        began_s = time.monotonic()
        process.terminate()
        _, err = process.communicate(timeout=_START_S)
        took_s = time.monotonic() - began_s
    assert process.returncode == 1
    assert f"SIGTERM: not ended within {END_LIMIT_S:g} s" in err
    assert took_s < 2 * END_LIMIT_S


def test_ready_is_said_when_everything_is_open(robot: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with _manager(robot, monkeypatch) as manager, _start(_on_loopback(robot / "uav.yaml")) as process:
        assert manager.recv(64) == b"READY=1"
        with socket.socket(socket.AF_UNIX) as asking:
            asking.connect(str(robot / "control.sock"))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link, pytest.raises(OSError, match="in use"):
            link.bind(("127.255.255.255", 17650))
        process.terminate()
        process.communicate(timeout=_START_S)
