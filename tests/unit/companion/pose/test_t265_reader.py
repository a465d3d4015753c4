"""The camera's reader on the real library's software device, in a process of its own as on a vehicle.

With pyrealsense2 2.53.1 on CPython 3.10 where `make t265` found one, and with the newest wheel on this interpreter.
"""

from __future__ import annotations

import importlib.util
import math
import os
import random
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from companion.host.unix_datagram import bind_datagram_socket
from companion.pose import wire
from companion.pose.t265_reader import DeviceClock, Reader, ReaderError
from tests.paths import ROOT

_ROOT = ROOT
_OWN = _ROOT / ".venv-t265" / "bin" / "python"
_MS = 1_000_000
_TRIES = 5
"""The socket holds ten datagrams: a test that gets no processor for 50 ms loses a pose, which the reader counts."""


def _python(which: str) -> str:
    if which == "own":
        if not _OWN.exists():
            pytest.skip("no .venv-t265: make t265 found no python3.10")
        return str(_OWN)
    if importlib.util.find_spec("pyrealsense2") is None:
        pytest.skip("pyrealsense2 is not installed for this interpreter")
    return sys.executable


def _environment() -> dict[str, str]:
    """With a libusb that the library finds, whether or not the system has one."""
    import libusb_package

    return os.environ | {"PYTHONPATH": str(_ROOT), "LD_PRELOAD": str(libusb_package.get_library_path())}


def _run(python: str, module: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [python, "-m", module, *arguments]
    return subprocess.run(command, env=_environment(), cwd=_ROOT, capture_output=True, text=True, timeout=60)


@contextmanager
def _service(path: Path) -> Iterator[list[tuple[int, wire.RawPose]]]:
    """Receives as the service does: what arrived, and when."""
    got: list[tuple[int, wire.RawPose]] = []
    stopped = threading.Event()

    def receive(sock: socket.socket) -> None:
        sock.settimeout(0.05)
        while not stopped.is_set():
            try:
                datagram = sock.recv(4096)
            except TimeoutError:
                continue
            got.append((time.monotonic_ns(), wire.decode(datagram)))

    with bind_datagram_socket(path) as sock:
        thread = threading.Thread(target=receive, args=(sock,))
        thread.start()
        try:
            yield got
        finally:
            stopped.set()
            thread.join()


@pytest.mark.parametrize("which", ["own", "newest"])
def test_every_frame_of_the_software_device_arrives(which: str, tmp_path: Path) -> None:
    python, path = _python(which), tmp_path / "pose.sock"
    for _ in range(_TRIES):
        with _service(path) as got:
            done = _run(python, "tests.faults.software_t265", "--socket", str(path), "--frames", "100")
        if done.stdout == "100 0\n":
            break
        path.unlink(missing_ok=True)
    assert (done.returncode, done.stdout) == (0, "100 0\n"), done.stderr
    poses = [pose for _, pose in got]
    assert len(poses) == 100 and {pose.session for pose in poses} == {7}
    assert [math.isnan(pose.position_m[0]) for pose in poses] == [number % 10 == 9 for number in range(100)]
    for number, pose in enumerate(poses):
        if number % 10 != 9:
            assert pose.position_m == pytest.approx((0.001 * number, 2.0, 3.0), abs=1e-6)
        assert pose.frame is wire.PoseFrame.T265 and pose.confidence == 3
        assert pose.velocity_m_s == pytest.approx((0.2, 0.0, 0.0)) and pose.quaternion_wxyz == (1.0, 0.0, 0.0, 0.0)
    stamps = [pose.t_mono_ns for pose in poses]
    assert stamps == sorted(stamps)
    assert all(stamp <= arrived_ns + _MS for (arrived_ns, _), stamp in zip(got, stamps, strict=True))
    assert (stamps[-1] - stamps[0]) / 1e9 == pytest.approx(99 / 200, abs=0.1)


def test_a_camera_that_falls_silent_ends_the_reader_with_code_1(tmp_path: Path) -> None:
    python = _python("own" if _OWN.exists() else "newest")
    done = _run(python, "tests.faults.software_t265", "--socket", str(tmp_path / "x"), "--frames", "5", "--silent")
    assert done.returncode == 1 and "no pose for 3 s; the camera hangs or was unplugged" in done.stderr


def test_without_a_camera_it_says_so(tmp_path: Path) -> None:
    python = _python("own" if _OWN.exists() else "newest")
    done = _run(python, "companion.pose.t265_reader", "--socket", str(tmp_path / "x"))
    assert done.returncode == 1 and "no T265 among 0 devices" in done.stderr


def test_a_recording_is_played_back(tmp_path: Path) -> None:
    python, bag = _python("own"), tmp_path / "flight.bag"
    made = _run(
        python, "tests.faults.software_t265", "--socket", str(tmp_path / "x"), "--frames", "60", "--record", str(bag)
    )
    assert made.returncode == 0, made.stderr
    with _service(tmp_path / "pose.sock") as got:
        done = _run(python, "companion.pose.t265_reader", "--socket", str(tmp_path / "pose.sock"), "--bag", str(bag))
    assert done.returncode == 0, done.stderr
    poses = [pose for _, pose in got if not math.isnan(pose.position_m[0])]
    numbers = [round(1000 * pose.position_m[0]) for pose in poses]
    # In real time, where the library passes over what it is late for: how many come is up to the machine.
    assert len(numbers) > 3
    assert numbers == sorted(set(numbers) & set(range(60)))
    for number, pose in zip(numbers, poses, strict=True):
        assert pose.position_m == pytest.approx((0.001 * number, 2.0, 3.0), abs=1e-6)


def test_device_time_is_put_on_the_monotonic_clock_by_the_shortest_delay() -> None:
    clock = DeviceClock()
    assert clock.monotonic_ns(1000.0, 5_010 * _MS) == 5_010 * _MS
    assert clock.monotonic_ns(1005.0, 5_012 * _MS) == 5_012 * _MS, "a shorter delay is believed at once"
    late = clock.monotonic_ns(1010.0, 5_040 * _MS)
    assert late == pytest.approx(5_017 * _MS, abs=_MS / 10), "a frame that came late keeps its own time"


def test_a_step_of_the_device_time_is_followed_and_never_leads_into_the_future() -> None:
    clock = DeviceClock()
    clock.monotonic_ns(1000.0, 5_000 * _MS)
    for number in range(1, 100):
        arrival_ns = (5_000 + 5 * number) * _MS
        stamp_ns = clock.monotonic_ns(31_000.0 + 5 * number, arrival_ns)
        assert stamp_ns <= arrival_ns
    assert stamp_ns == arrival_ns


@pytest.mark.parametrize("step_ms", [-240.0, -60.0, -20.0, -4.0, 20.0, 240.0, -86_400_000.0, 86_400_000.0])
@pytest.mark.parametrize("uptime_ms", [1_000, 100_000])
def test_a_step_of_the_wall_clock_moves_no_pose_for_longer_than_a_second(step_ms: float, uptime_ms: int) -> None:
    """NTP steps; each frame is 0.5 to 3 ms on its way. Poses are off by that alone within a second."""
    chance, clock, wall_ms = random.Random(1), DeviceClock(), 1.7e12
    errors_ms = []
    for number in range(1200):
        true_ms = uptime_ms + 5 * number
        wall_ms = 1.7e12 + 5 * number + (step_ms if number >= 600 else 0.0)
        arrival_ns = round((true_ms + chance.uniform(0.5, 3.0)) * _MS)
        stamp_ns = clock.monotonic_ns(wall_ms, arrival_ns)
        assert 0 <= stamp_ns <= arrival_ns
        errors_ms.append(stamp_ns / _MS - true_ms)
    assert all(0 <= error < 3.1 for error in errors_ms[:600])
    assert all(0 <= error < 0.8 for error in errors_ms[800:])
    if step_ms <= -20:
        assert clock.steps == 1
        assert all(0 <= error < 3.1 for error in errors_ms[600:]), "a step back shows at once"


def test_frames_that_waited_keep_their_times() -> None:
    clock = DeviceClock()
    for number in range(200):
        clock.monotonic_ns(1000.0 + 5 * number, (5_001 + 5 * number) * _MS)
    for number in range(200, 264):  # the host stood still for a second, and the queue held these
        stamp_ns = clock.monotonic_ns(1000.0 + 5 * number, (5_001 + 5 * 400) * _MS)
        assert stamp_ns == (5_001 + 5 * number) * _MS


@pytest.mark.parametrize("device_ms", [float("nan"), float("inf"), -1e300, 1e300])
def test_a_time_that_is_none_ends_nothing(device_ms: float) -> None:
    clock = DeviceClock()
    for number, ms in enumerate((1000.0, device_ms, 1010.0, 1015.0)):
        stamp_ns = clock.monotonic_ns(ms, (5_000 + 5 * number) * _MS)
        wire.encode(
            wire.RawPose(
                t_mono_ns=stamp_ns,
                position_m=(0, 0, 0),
                quaternion_wxyz=(1, 0, 0, 0),
                velocity_m_s=(0, 0, 0),
                confidence=3,
                frame=wire.PoseFrame.T265,
            )
        )
    assert abs(stamp_ns - 5_015 * _MS) <= 15 * _MS


@pytest.mark.parametrize("name", ["file", "file/below", "n" * 300])
def test_a_socket_that_is_none_ends_the_reader_with_a_line(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    reader = Reader(str(tmp_path / name), 1)
    pose = wire.RawPose(
        t_mono_ns=1,
        position_m=(0.0, 0.0, 0.0),
        quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
        velocity_m_s=(0.0, 0.0, 0.0),
        confidence=3,
        frame=wire.PoseFrame.T265,
        session=1,
    )
    with reader._socket:
        if name == "file":  # the kernel says of a file what it says of a socket that nobody reads
            reader._send(pose)
            assert reader.lost == 1
            return
        with pytest.raises(ReaderError, match="poses cannot be sent there"):
            reader._send(pose)
