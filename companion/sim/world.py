"""The world of the demo as a process of its own: `python -m companion.sim.world --scenario FILE.json`.

It hears where the vehicle truly is and stands where hardware would: CSI records go where the patched driver would put
them, poses where the camera's reader process would. Time starts with the first VehicleTruth; until then the world is
silent. Ends on SIGTERM or SIGINT.
"""

from __future__ import annotations

import argparse
import bisect
import signal
import socket
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from operator import itemgetter
from pathlib import Path
from types import FrameType
from typing import Final, Protocol

import msgspec

from companion.errors import CompanionError
from companion.host.unix_datagram import bind_datagram_socket
from companion.pose import wire
from companion.sim import truth
from companion.sim.environment import Sample, World
from companion.sim.scenario import CsiEndpoint, Scenario, load_scenario
from csi_bridge.encoder import encode_bodies
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.netlink import VendorEventFeeder
from csi_bridge.feitcsi.records import FEITCSI_CODE, FeitRecord
from csi_bridge.netlink import NetlinkError, NetlinkFeeder
from csi_bridge.records import CSI_CODE, CsiRecord
from csi_bridge.unix_socket import UnixFeeder

_TICK_NS: Final = 15_000_000
"""Records and poses come at most this late, which their own time stamps show; shorter ticks cost more of a core."""
_DATAGRAM_BYTES: Final = 4096


class WorldError(CompanionError):
    """The world cannot start; the message names the socket or transport."""


class CsiFeeder(Protocol):
    """Where the driver's records go."""

    def send(self, code: int, body: bytes) -> bool: ...

    def close(self) -> None: ...


class _Sockets:
    """Every edge of the process; whoever does not listen is ignored."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._out = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._feed_uav = _feeder(scenario.uav.csi)
        self._feed_beacon = _feeder(scenario.beacon.csi)
        self._truth_in = bind_datagram_socket(Path(scenario.truth_in))
        self._waiting: list[tuple[int, Callable[[], object]]] = []
        """By time, the earliest first."""

    def vehicle_states(self) -> list[truth.VehicleTruth]:
        states = []
        while True:
            try:
                states.append(truth.decode_vehicle(self._truth_in.recv(_DATAGRAM_BYTES)))
            except BlockingIOError:
                return states
            except msgspec.DecodeError as error:
                raise WorldError(f"{self._scenario.truth_in}: a datagram is no VehicleTruth: {error}") from None

    def take(self, sample: Sample) -> None:
        """What is to be sent when its time comes."""
        scenario = self._scenario
        for feeder, records, times_ns in (
            (self._feed_uav, sample.csi_uav, sample.csi_uav_ns),
            (self._feed_beacon, sample.csi_beacon, sample.csi_beacon_ns),
        ):
            sends = [partial(feeder.send, code, body) for code, body in _encoded(records)]
            self._waiting += zip(times_ns, sends, strict=True)
        for robot, poses in ((scenario.uav, sample.poses_uav), (scenario.beacon, sample.poses_beacon)):
            self._waiting += [
                (pose.t_mono_ns, partial(self._send_to, robot.pose_socket, wire.encode(pose))) for pose in poses
            ]
        if (world := sample.world) is not None:
            self._waiting.append((world.t_mono_ns, partial(self._send_to, scenario.truth_out, truth.encode(world))))
        self._waiting.sort(key=itemgetter(0))

    def send_due(self, now_ns: int) -> None:
        """What has happened by now."""
        count = bisect.bisect_right(self._waiting, now_ns, key=itemgetter(0))
        for _, send in self._waiting[:count]:
            send()
        del self._waiting[:count]

    def close(self) -> None:
        for opened in (self._truth_in, self._out, self._feed_uav, self._feed_beacon):
            opened.close()
        Path(self._scenario.truth_in).unlink(missing_ok=True)

    def _send_to(self, path: str, datagram: bytes) -> None:
        try:
            self._out.sendto(datagram, path)
        except (BlockingIOError, ConnectionRefusedError, FileNotFoundError):
            return  # as with hardware: what nobody reads is lost


def _encoded(records: list[CsiRecord] | list[FeitRecord]) -> list[tuple[int, bytes]]:
    """Codes and bodies, as the card's driver would send them."""
    ours = [record for record in records if isinstance(record, CsiRecord)]
    return [(CSI_CODE, body) for body in encode_bodies(ours)] + [
        (FEITCSI_CODE, encode_record(record)) for record in records if isinstance(record, FeitRecord)
    ]


class _Stop:
    """Set by SIGTERM and SIGINT."""

    def __init__(self) -> None:
        self.asked = False
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._ask)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit 0 after a signal, 1 when a socket or transport is refused, 2 for a bad scenario."""
    parser = argparse.ArgumentParser(prog="python -m companion.sim.world", description="The simulated world.")
    parser.add_argument("--scenario", type=Path, required=True, metavar="FILE.json")
    stop = _Stop()
    try:
        _live(load_scenario(parser.parse_args(arguments).scenario), stop)
    except CompanionError as error:
        print(f"world: {error}", file=sys.stderr)
        return error.exit_code
    return 0


def _live(scenario: Scenario, stop: _Stop) -> None:
    sockets = _Sockets(scenario)
    try:
        world = World(scenario, time.time_ns() - time.monotonic_ns())
        deadline_ns = time.monotonic_ns()
        while not stop.asked:
            for vehicle in sockets.vehicle_states():
                world.hear(vehicle)
            now_ns = time.monotonic_ns()
            # What is known ahead of time is made at once, every other tick: most of a step's cost is that it is one.
            sample = None if world.is_known(now_ns) else world.advance(now_ns)
            if sample is not None:
                sockets.take(sample)
            sockets.send_due(now_ns)
            # After a stall the missed ticks are left out: one step makes up for all of them.
            deadline_ns = max(deadline_ns + _TICK_NS, time.monotonic_ns())
            time.sleep(max(0, deadline_ns - time.monotonic_ns()) * 1e-9)
    finally:
        sockets.close()


def _feeder(endpoint: CsiEndpoint) -> CsiFeeder:
    if endpoint.transport == "unix":
        return UnixFeeder(endpoint.path)
    try:
        feeder = VendorEventFeeder if endpoint.transport == "nl80211" else NetlinkFeeder
        return feeder(endpoint.connector_idx)
    except NetlinkError as error:
        raise WorldError(f"CSI over netlink: {error.strerror}; transport unix works without it") from None


if __name__ == "__main__":
    sys.exit(main())
