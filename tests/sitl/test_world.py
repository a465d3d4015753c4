"""The world as a process, on the sockets that hardware would have."""

from __future__ import annotations

import math
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.host.unix_datagram import bind_datagram_socket
from companion.pose import wire
from companion.sim import truth
from companion.sim.scenario import Scenario, encode_scenario
from csi_bridge.netlink import NetlinkSource
from csi_bridge.parser import parse_body
from csi_bridge.records import CsiRecord
from csi_bridge.source import CsiSource
from csi_bridge.unix_socket import UnixSource
from tests.connectors import claimed, needs_netlink
from tests.sim_scenes import scene
from tests.vehicle_truth import vehicle_truth

SPEED_M_S = 4.0
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@contextmanager
def _world(scenario: Scenario, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    path = folder / "scenario.json"
    path.write_bytes(encode_scenario(scenario))
    process = subprocess.Popen(
        [sys.executable, "-m", "companion.sim.world", "--scenario", str(path)], stderr=subprocess.PIPE
    )
    try:
        _wait(lambda: Path(scenario.truth_in).exists() or process.poll() is not None)
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def _wait(done: Callable[[], bool], limit_s: float = 20.0) -> None:
    deadline_s = time.monotonic() + limit_s
    while not done():
        assert time.monotonic() < deadline_s, "waited too long"
        time.sleep(0.01)


class _Listener:
    """Both robots' ends and the demo's, and a vehicle that flies straight at SPEED_M_S towards the beacon."""

    def __init__(
        self, scenario: Scenario, sources: tuple[NetlinkSource, NetlinkSource] | tuple[UnixSource, UnixSource]
    ) -> None:
        self._scenario = scenario
        self._sources = sources
        robots = (scenario.uav, scenario.beacon)
        self._pose_sockets = [bind_datagram_socket(Path(robot.pose_socket)) for robot in robots]
        self._truth_socket = bind_datagram_socket(Path(scenario.truth_out))
        self._out = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.records: tuple[list[CsiRecord], list[CsiRecord]] = ([], [])
        self.poses: tuple[list[wire.RawPose], list[wire.RawPose]] = ([], [])
        self.truths: list[truth.WorldTruth] = []
        self.lateness_s: list[float] = []

    def fly(self, duration_s: float) -> None:
        start_ns = time.monotonic_ns()
        while (now_ns := time.monotonic_ns()) < start_ns + duration_s * 1e9:
            way_m = min(SPEED_M_S * (now_ns - start_ns) * 1e-9, self._scenario.start_distance_m)
            state = vehicle_truth(now_ns, (way_m, 0.0, 0.4), (SPEED_M_S, 0.0, 0.0))
            self._out.sendto(truth.encode(state), self._scenario.truth_in)
            time.sleep(0.01)
            self._drain()

    def close(self) -> None:
        for opened in (*self._sources, *self._pose_sockets, self._truth_socket, self._out):
            opened.close()

    def _drain(self) -> None:
        sources: tuple[CsiSource, ...] = self._sources
        for records, source in zip(self.records, sources, strict=True):
            for code, body in source.drain():
                record = parse_body(code, body)
                assert isinstance(record, CsiRecord)
                records.append(record)
        for poses, opened in zip(self.poses, self._pose_sockets, strict=True):
            poses += [wire.decode(datagram) for datagram in _waiting(opened)]
        if self.poses[0]:
            self.lateness_s.append((time.monotonic_ns() - self.poses[0][-1].t_mono_ns) * 1e-9)
        self.truths += [truth.decode_world(datagram) for datagram in _waiting(self._truth_socket)]


def _waiting(opened: socket.socket) -> Iterator[bytes]:
    with suppress(BlockingIOError):
        while True:
            yield opened.recv(4096)


def _cpu_s(process: subprocess.Popen[bytes]) -> float:
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


def _approach(folder: Path, connectors: Sequence[int] = ()) -> Scenario:
    """The beacon due East, driving North."""
    scenario = scene(seed=3, folder=folder, connectors=connectors)
    return replace(scenario, beacon_azimuth_rad=0.0, drive_azimuth_rad=math.pi / 2)


def _check_flight(listener: _Listener) -> None:
    """Rates over the times that things themselves are of: when the world came to send them is the machine's matter."""
    for records in listener.records:
        span_us = (records[-1].timestamp_low_us - records[0].timestamp_low_us) % (1 << 32)
        assert span_us > 500_000
        assert len(records) == pytest.approx(150 * span_us * 1e-6 * 0.95, rel=0.15)
    at_uav, at_beacon = ({r.frame_count for r in records} for records in listener.records)
    assert len(at_uav & at_beacon) == pytest.approx(0.95 * len(at_uav), rel=0.15)
    for poses in listener.poses:
        assert len(poses) == pytest.approx((poses[-1].t_mono_ns - poses[0].t_mono_ns) / 5e6, rel=0.15)
        # A reader that comes late finds its socket full once; the poses themselves are made on the dot.
        steps = np.diff([pose.t_mono_ns for pose in poses]) / 5e6
        np.testing.assert_allclose(steps, np.round(steps), atol=0.02)
        assert np.mean(np.round(steps) > 1) < 0.05
    assert np.median(listener.lateness_s) < 0.2
    assert len(listener.truths) == pytest.approx(
        (listener.truths[-1].t_mono_ns - listener.truths[0].t_mono_ns) / 5e7, rel=0.15
    )


def _check_truth(truths: list[truth.WorldTruth]) -> None:
    # How far the vehicle has come before the world has started is the machine's matter.
    assert truths[0].distance_m == pytest.approx(15.0 - truths[0].uav_antenna_enu_m[0], abs=0.2)
    for world in truths:
        assert world.distance_m == pytest.approx(math.dist(world.uav_antenna_enu_m, world.beacon_antenna_enu_m))
        driving = math.hypot(*world.beacon_v_enu_m_s) > 0
        if world.distance_m > 7.6:
            assert not driving
        if world.distance_m < 7.0:
            assert driving
            assert world.beacon_antenna_enu_m[1] > -0.021
    assert truths[-1].beacon_v_enu_m_s == pytest.approx((0.0, 0.1, 0.0))
    assert truths[-1].exchanges > 300


def test_a_flight_on_unix_sockets(tmp_path: Path) -> None:
    scenario = _approach(tmp_path)
    with _world(scenario, tmp_path) as process:
        listener = _Listener(scenario, (UnixSource(scenario.uav.csi.path), UnixSource(scenario.beacon.csi.path)))
        listener.fly(0.2)
        begin, begin_s = _cpu_s(process), time.monotonic()
        listener.fly(3.0)
        share = (_cpu_s(process) - begin) / (time.monotonic() - begin_s)
        print(f"world: {share:.1%} of a core at 150 exchanges/s and 2 x 200 poses/s")
        process.send_signal(signal.SIGTERM)
        assert process.wait(20.0) == 0
        assert not Path(scenario.truth_in).exists()
        assert process.stderr is not None and process.stderr.read() == b""
    listener.close()
    _check_flight(listener)
    _check_truth(listener.truths)


@needs_netlink
def test_a_flight_on_the_kernel_connector(tmp_path: Path) -> None:
    with claimed(2) as connectors:
        _fly_on(connectors, tmp_path)


def _fly_on(connectors: list[int], tmp_path: Path) -> None:
    scenario = _approach(tmp_path, connectors)
    with _world(scenario, tmp_path) as process:
        listener = _Listener(scenario, (NetlinkSource(connectors[0], False), NetlinkSource(connectors[1], False)))
        listener.fly(1.5)
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 0
    listener.close()
    _check_flight(listener)
    assert {r.mac for r in listener.records[0]}.isdisjoint(r.mac for r in listener.records[1])


def test_it_waits_for_the_vehicle_and_ignores_who_is_not_there(tmp_path: Path) -> None:
    scenario = _approach(tmp_path)
    with _world(scenario, tmp_path) as process:
        out = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        with out, bind_datagram_socket(Path(scenario.uav.pose_socket)) as poses:
            time.sleep(0.2)
            assert list(_waiting(poses)) == [], "nothing may happen before the vehicle is there"
            for _ in range(20):
                state = vehicle_truth(time.monotonic_ns(), (0.0, 0.0, 0.0), mode="HOLD")
                out.sendto(truth.encode(state), scenario.truth_in)
                time.sleep(0.01)
            assert len(list(_waiting(poses))) > 5, "poses flow although no CSI socket and no demo is there"
            time.sleep(0.6)
            assert len(list(_waiting(poses))) > 5, "a silent autopilot leaves the vehicle where it was"
        assert process.poll() is None


@pytest.mark.parametrize(
    ("text", "named"),
    [(b"{}", "seed"), (b"[", "scenario.json"), (None, "cannot read")],
)
def test_a_bad_scenario_is_one_line_and_exit_2(tmp_path: Path, text: bytes | None, named: str) -> None:
    path = tmp_path / "scenario.json"
    if text is not None:
        path.write_bytes(text)
    done = subprocess.run(
        [sys.executable, "-m", "companion.sim.world", "--scenario", str(path)],
        capture_output=True,
        text=True,
        timeout=20,
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and named in done.stderr
    assert "Traceback" not in done.stderr
