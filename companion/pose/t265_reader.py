"""The camera's reader: poses of an Intel T265 to the service's pose socket. A process of its own.

    python3.10 -m companion.pose.t265_reader --socket /run/companion/pose.sock [--bag FILE] [--serial NUMBER]

Needs the standard library and pyrealsense2 only (requirements-t265.txt), so that it runs on the CPython 3.10 for which
the last librealsense with T265 support (2.53.1) has wheels. It contains that camera's faults: when no device is there
or no pose has come for some seconds it ends with code 1, and who started it (systemd, or the service) starts it again.

Pose jumping and relocalisation are switched off: a map correction in flight would be a jump of the aperture and, where
poses are forwarded, of the vehicle. Times are the device's, put on CLOCK_MONOTONIC by the shortest delay seen.
"""

from __future__ import annotations

import argparse
import os
import signal
import socket
import sys
import time
from types import FrameType
from typing import Any, Optional

from companion.pose import wire

_SILENT_S = 3.0
_WAIT_MS = 250
_QUEUE_FRAMES = 64
_DRIFT = 1e-4
"""How fast the offset between the clocks may grow: crystals are within 50 ppm of each other."""
_STEP_NS = 250_000_000
_STEPS = 50


class ReaderError(Exception):
    """The camera cannot be read; the message says why."""


class DeviceClock:
    """The device's milliseconds on the host's monotonic clock: the smallest delay between the two is the offset.

    A step of the device's time (librealsense may follow the wall clock) is followed after `_STEPS` frames.
    """

    def __init__(self) -> None:
        self._offset_ns: Optional[int] = None  # noqa: UP045 - this file also runs where typing is older
        self._before_ns = 0
        self._strange = 0

    def monotonic_ns(self, device_ms: float, arrival_ns: int) -> int:
        device_ns = round(device_ms * 1e6)
        offset_ns = arrival_ns - device_ns
        known_ns = self._offset_ns
        if known_ns is None:
            known_ns = offset_ns
        elif abs(offset_ns - known_ns) > _STEP_NS:
            self._strange += 1
            if self._strange < _STEPS:
                return min(arrival_ns, device_ns + known_ns) if offset_ns > known_ns else arrival_ns
            known_ns = offset_ns
        else:
            self._strange = 0
            grown_ns = known_ns + round(_DRIFT * (arrival_ns - self._before_ns))
            known_ns = min(offset_ns, grown_ns)
        self._strange = 0
        self._before_ns, self._offset_ns = arrival_ns, known_ns
        return device_ns + known_ns


def open_pose_sensor(rs: Any, device: Any) -> Any:
    """The pose sensor of a device, with its queue: opened and started. Raises ReaderError when it has none."""
    for sensor in device.query_sensors():
        for profile in sensor.get_stream_profiles():
            if profile.stream_type() == rs.stream.pose:
                _forbid_jumps(rs, sensor)
                queue = rs.frame_queue(_QUEUE_FRAMES)
                sensor.open(profile)
                sensor.start(queue)
                return sensor, queue
    raise ReaderError("the device has no pose stream; expected an Intel T265")


def raw_pose(frame: Any, t_mono_ns: int, session: int) -> wire.RawPose:
    """One frame in the tracker's own axes."""
    pose = frame.as_pose_frame().get_pose_data()
    p, q, v = pose.translation, pose.rotation, pose.velocity
    return wire.RawPose(
        t_mono_ns,
        (p.x, p.y, p.z),
        (q.w, q.x, q.y, q.z),
        (v.x, v.y, v.z),
        min(3, int(pose.tracker_confidence)),
        wire.PoseFrame.T265,
        session,
    )


class Reader:
    """Sends one datagram for each frame until stopped. Nobody listening is no error: the service may start later."""

    def __init__(self, path: str, session: int) -> None:
        self._path = path
        self._session = session
        self._clock = DeviceClock()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.sent = 0
        self.lost = 0
        self.stopped = False

    def run(self, queue: Any) -> None:
        """Raises ReaderError when frames stop."""
        newest_ns = time.monotonic_ns()
        while not self.stopped:
            try:
                frame = queue.wait_for_frame(_WAIT_MS)
            except RuntimeError:  # none within that time
                if time.monotonic_ns() - newest_ns > _SILENT_S * 1e9:
                    raise ReaderError(f"no pose for {_SILENT_S:g} s; the camera hangs or was unplugged") from None
                continue
            newest_ns = time.monotonic_ns()
            self._send(raw_pose(frame, self._clock.monotonic_ns(frame.get_timestamp(), newest_ns), self._session))

    def _send(self, pose: wire.RawPose) -> None:
        try:
            self._socket.sendto(wire.encode(pose), self._path)
            self.sent += 1
        except (BlockingIOError, ConnectionRefusedError, FileNotFoundError):
            self.lost += 1


def _forbid_jumps(rs: Any, sensor: Any) -> None:
    for name in ("enable_pose_jumping", "enable_relocalization", "enable_map_preservation"):
        option = getattr(rs.option, name, None)
        if option is not None and sensor.supports(option):
            sensor.set_option(option, 0)


def _device(rs: Any, bag: str, serial: str) -> Any:
    context = rs.context()
    if bag:
        return context.load_device(bag)
    found = list(context.query_devices())
    for device in found:
        name = device.get_info(rs.camera_info.name)
        if "T265" in name and serial in ("", device.get_info(rs.camera_info.serial_number)):
            return device
    wanted = f"T265 {serial}".strip()
    raise ReaderError(f"no {wanted} among {len(found)} devices; after a warm reboot unplug it and plug it in again")


def main() -> int:
    """Exit 0 when stopped by a signal, 1 when the camera cannot be read."""
    parser = argparse.ArgumentParser(prog="t265_reader", description="Poses of an Intel T265 to the pose socket.")
    parser.add_argument("--socket", required=True, help="the service's pose socket")
    parser.add_argument("--bag", default="", help="play back this recording instead of a camera")
    parser.add_argument("--serial", default="", help="only the camera with this serial number")
    arguments = parser.parse_args()
    import pyrealsense2 as rs  # late: --help works without it

    reader = Reader(arguments.socket, int.from_bytes(os.urandom(2), "little"))

    def stop(number: int, frame: Optional[FrameType]) -> None:  # noqa: UP045
        reader.stopped = True

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    try:
        sensor, queue = open_pose_sensor(rs, _device(rs, arguments.bag, arguments.serial))
        try:
            reader.run(queue)
        finally:
            sensor.stop()
            sensor.close()
    except (ReaderError, RuntimeError) as error:
        if arguments.bag and reader.sent + reader.lost:
            return 0  # the end of the recording
        print(f"t265_reader: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
