"""`companion doctor autopilot` on the mock PX4 and on what is none."""

from __future__ import annotations

import dataclasses
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pymavlink.dialects.v20 import development as mavlink

from companion.config.file import load_config, save_config
from companion.config.schema import AutopilotConfig
from companion.sim.stage import free_udp_port
from tests.paths import CONFIGS

_RIGHT = ("COM_OBL_RC_ACT=5", "COM_RC_OVERRIDE=3", "RTL_RETURN_ALT=3")


def test_it_names_the_vehicle_and_its_parameters(tmp_path: Path) -> None:
    port = free_udp_port("127.0.0.1")
    with _mock(port, *_RIGHT):
        code, out, err = _doctor(tmp_path, port)
    assert (code, err) == (0, "")
    vehicle, arming, *parameters = (line.split(maxsplit=2) for line in out.splitlines())
    assert vehicle == ["OK", "vehicle", "system 1, px4 1.16.1"]
    assert arming == ["OK", "arming", "checks           PX4's own pass"]
    assert (
        len(parameters) == 10 and ["OK", "COM_OBL_RC_ACT", "5"] in parameters and ["OK", "GF_ACTION", "2"] in parameters
    )


def test_each_wrong_parameter_is_a_line(tmp_path: Path) -> None:
    port = free_udp_port("127.0.0.1")
    with _mock(port, *_RIGHT[1:]):
        code, out, err = _doctor(tmp_path, port)
    assert code == 1 and err == "companion: not ready: COM_OBL_RC_ACT\n"
    assert "FAILED COM_OBL_RC_ACT          0; wanted 4 (land) or 5 (hold): what PX4 does when the stream is lost" in out


def test_what_is_no_px4_is_refused_in_one_line(tmp_path: Path) -> None:
    port = free_udp_port("127.0.0.1")
    with _ardupilot(port):
        code, out, err = _doctor(tmp_path, port, "--seconds", "2")
    assert code == 1 and err == "companion: not ready: vehicle\n"
    assert out.count("\n") == 1 and "system 7 (ArduPilot) is no PX4 and is left alone" in out


def _doctor(folder: Path, port: int, *options: str) -> tuple[int, str, str]:
    config = load_config(CONFIGS / "demo-uav.yaml")
    save_config(
        dataclasses.replace(config, autopilot=AutopilotConfig(f"udpin://127.0.0.1:{port}", gps=True)),
        folder / "uav.yaml",
    )
    command = [sys.executable, "-m", "companion", "doctor", "autopilot", "--config", str(folder / "uav.yaml"), *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout, done.stderr


@contextmanager
def _mock(port: int, *parameters: str) -> Iterator[None]:
    options = [word for one in parameters for word in ("--param", one)]
    command = [sys.executable, "-m", "companion.sim.px4.autopilot", "--connect", f"127.0.0.1:{port}", *options]
    with subprocess.Popen(command) as process:
        try:
            yield
        finally:
            process.terminate()


@contextmanager
def _ardupilot(port: int) -> Iterator[None]:
    """Heartbeats of another autopilot, ten a second."""
    over = threading.Event()
    codec = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)

    def speak() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            while not over.wait(0.1):
                sock.sendto(mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3).pack(codec), ("127.0.0.1", port))

    thread = threading.Thread(target=speak)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
