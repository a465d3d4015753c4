"""The signing relay as a process: what passes, how late, and what does not, whatever is sent, stopped or killed."""

from __future__ import annotations

import os
import secrets
import signal
import socket
import statistics
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from companion.signing.lines import OLDEST_S
from tests.faults.campaigns import FULL
from tests.signed_link import Vehicle, setpoint, wait_until
from tests.sitl.relay_process import RelayProcess, drained

FORGERIES = 1_000_000 if FULL else 100_000
SPEED = 921600


@pytest.fixture
def relay(tmp_path: Path) -> Iterator[RelayProcess]:
    with RelayProcess(tmp_path) as process:
        yield process


def connected(relay: RelayProcess) -> tuple[Vehicle, tuple[str, int]]:
    """A vehicle that the relay has taken, and where the library's frames are to be sent to."""
    vehicle = Vehicle(relay.key)
    relay.library.settimeout(0.2)
    deadline_s = time.monotonic() + 20
    while time.monotonic() < deadline_s:
        relay.vehicle.sendto(vehicle.heartbeat(), relay.line)
        try:
            _, inner = relay.library.recvfrom(4096)
        except TimeoutError:
            continue
        relay.library.settimeout(1.0)
        drained(relay.library)
        drained(relay.vehicle)
        return vehicle, inner
    raise AssertionError(f"the relay hands nothing on: {relay.said or relay.report}")


def test_what_it_costs_in_time_over_udp(relay: RelayProcess) -> None:
    """Compared with the same way without a relay: a datagram from one socket of this process to another."""
    vehicle, inner = connected(relay)
    out, back = [], []
    for number in range(1, 401):
        begun_s = time.perf_counter()
        relay.library.sendto(setpoint(number), inner)
        (taken,) = vehicle.read(relay.vehicle.recv(4096))
        out.append(time.perf_counter() - begun_s)
        assert taken.time_boot_ms == number
        frame = vehicle.frame(number)
        begun_s = time.perf_counter()
        relay.vehicle.sendto(frame, relay.line)
        assert relay.library.recv(4096) == frame, "as it came, with its signature"
        back.append(time.perf_counter() - begun_s)
        time.sleep(0.002)
    for name, took in (("to the vehicle", out), ("from the vehicle", back)):
        took.sort()
        print(f"{name}: median {1e3 * took[200]:.3f} ms, 99 % {1e3 * took[395]:.3f} ms, most {1e3 * took[-1]:.3f} ms")
        assert statistics.median(took) < 0.02


def test_over_a_serial_line(tmp_path: Path) -> None:
    master, slave = os.openpty()
    with RelayProcess(tmp_path, f"serial://{os.ttyname(slave)}:{SPEED}") as relay:
        vehicle, took = Vehicle(relay.key), []
        relay.library.settimeout(0.2)
        inner: tuple[str, int] | None = None
        while inner is None:
            os.write(master, vehicle.heartbeat() + b"noise")
            try:
                _, inner = relay.library.recvfrom(4096)
            except TimeoutError:
                assert not relay.said, relay.said
        time.sleep(0.1)
        os.set_blocking(master, False)
        _read(master)
        os.set_blocking(master, True)
        for number in range(1, 201):
            begun_s = time.perf_counter()
            relay.library.sendto(setpoint(number), inner)
            found: list[Any] = []
            while not found:
                found = [one for one in vehicle.read(os.read(master, 4096)) if one.get_type() != "HEARTBEAT"]
            took.append(time.perf_counter() - begun_s)
            assert found[0].time_boot_ms == number
        print(
            f"serial (pty), to the vehicle: median {1e3 * statistics.median(took):.3f} ms, most {1e3 * max(took):.3f}"
        )
        os.close(slave)
        os.close(master)
        wait_until(lambda: "it is gone" in relay.said or "Input/output error" in relay.said)


@pytest.mark.long
def test_fault_52_of_100_000_forged_and_unsigned_frames_none_is_taken_and_set_points_go_on(relay: RelayProcess) -> None:
    vehicle, inner = connected(relay)
    frames = [vehicle.frame(number) for number in range(20)]
    for frame in frames:
        relay.vehicle.sendto(frame, relay.line)
        relay.library.recv(4096)
    strangers = [Vehicle(secrets.token_bytes(32), timestamp=(1 << 47)), Vehicle(None)]
    forged = [stranger.frame(number) for stranger in strangers for number in range(200)]
    forged += [bytes((*frame[:20], frame[20] ^ 1, *frame[21:])) for frame in frames] + frames
    cpu_s, begun_s, took, sent = relay.cpu_s(), time.monotonic(), [], 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger_socket:
        for number in range(FORGERIES):
            stranger_socket.sendto(forged[number % len(forged)], relay.line)
            sent += 1
            if number % 2000 == 0:
                begun = time.perf_counter()
                relay.library.sendto(setpoint(number), inner)
                while not vehicle.read(relay.vehicle.recv(4096)):
                    pass
                took.append(time.perf_counter() - begun)
    seconds = time.monotonic() - begun_s
    time.sleep(1.2)
    assert drained(relay.library) == []
    counted = relay.report.wrong + relay.report.used + relay.report.unsigned + relay.report.old
    print(
        f"{sent} forgeries in {seconds:.1f} s, {counted} judged (the rest lost in the socket), "
        f"{relay.cpu_s() - cpu_s:.1f} s of processor; set points meanwhile: median "
        f"{1e3 * statistics.median(took):.2f} ms, most {1e3 * max(took):.2f} ms"
    )
    assert counted > 1000 and len(took) == FORGERIES // 2000
    assert max(took) < OLDEST_S
    frame = vehicle.frame(1)
    relay.vehicle.sendto(frame, relay.line)
    assert relay.library.recv(4096) == frame, "no forged time has shut the vehicle out"


def test_fault_53_nothing_older_than_a_tenth_of_a_second_passes_a_relay_that_stood_still(relay: RelayProcess) -> None:
    vehicle, inner = connected(relay)
    sent_s: dict[int, float] = {}

    def send(number: int) -> None:
        sent_s[number] = time.monotonic()
        relay.library.sendto(setpoint(number), inner)

    send(1)
    assert vehicle.read(relay.vehicle.recv(4096))[0].time_boot_ms == 1
    for stop in range(5):
        stopped = threading.Thread(target=relay.stop, args=(0.7,))
        stopped.start()
        for number in range(40):
            send(100 * (stop + 1) + number)
            relay.vehicle.sendto(vehicle.frame(number), relay.line)
            time.sleep(0.025)
        stopped.join()
        time.sleep(0.2)
        now_s = time.monotonic()
        ages = []
        for data in drained(relay.vehicle):
            for one in vehicle.read(data):
                if one.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                    ages.append(now_s - sent_s[one.time_boot_ms])
        # Sent over 1 s, 0.7 s of it while the relay stood still: what passed was sent before the stop or at most 0.1 s
        # before its end.
        numbers = len(ages)
        assert 2 <= numbers <= 40 - 20, numbers
    assert relay.report.old > 50


def test_a_frame_recorded_before_a_kill_is_refused_after_it_and_the_vehicle_is_taken_again(relay: RelayProcess) -> None:
    vehicle, _ = connected(relay)
    recorded = [vehicle.frame(number) for number in range(30)]
    for frame in recorded:
        relay.vehicle.sendto(frame, relay.line)
        assert relay.library.recv(4096) == frame
    time.sleep(1.2)  # they are in the book; those of the last second are under its guard
    relay.end(signal.SIGKILL)
    relay.start()
    time.sleep(1.5)
    for frame in recorded:
        relay.vehicle.sendto(frame, relay.line)
    time.sleep(0.7)
    assert drained(relay.library) == []
    begun_s = time.monotonic()
    vehicle.mav.signing.timestamp = Vehicle(relay.key).mav.signing.timestamp  # its clock has gone on
    connected_again, _ = connected(relay)
    assert connected_again.mav.signing.timestamp > vehicle.mav.signing.timestamp
    assert time.monotonic() - begun_s < 4


def test_a_vehicle_whose_time_is_far_behind_learns_it_from_the_relays_own_heartbeat(relay: RelayProcess) -> None:
    vehicle = Vehicle(relay.key, timestamp=1000)
    deadline_s = time.monotonic() + 20
    heard = False
    relay.vehicle.settimeout(0.2)
    relay.library.settimeout(0.05)
    while not heard:
        assert time.monotonic() < deadline_s
        relay.vehicle.sendto(vehicle.frame(1), relay.line)
        for data in drained(relay.vehicle):
            vehicle.read(data)
        try:
            heard = bool(relay.library.recv(4096))
        except TimeoutError:
            time.sleep(0.05)
    assert vehicle.mav.signing.timestamp > 10**9


def _read(fd: int) -> bytes:
    try:
        return os.read(fd, 65536)
    except BlockingIOError:
        return b""
