"""The camera's reader: poses of an Intel T265 to the service's pose socket. A process of its own.

    python3.10 -m companion.pose.t265_reader --socket /run/companion/pose.sock [--bag FILE] [--serial NUMBER]

Needs the standard library and pyrealsense2 only (requirements-t265.txt), so that it runs on the CPython 3.10 for which
the last librealsense with T265 support (2.53.1) has wheels. It contains that camera's faults: when no device is there
or no pose has come for some seconds it ends with code 1, and who started it (systemd, or the service) starts it again.

Pose jumping and relocalisation are switched off: a map correction in flight would be a jump of the aperture and, where
poses are forwarded, of the vehicle. Times are the device's, put on CLOCK_MONOTONIC by the shortest delay of late.
"""

from __future__ import annotations

import argparse
import math
import os
import signal
import socket
import sys
import time
from collections import deque
from types import FrameType
from typing import Any, Deque, Optional  # noqa: UP035 - this file also runs where typing is older

from companion.pose import wire

_SILENT_S = 3.0
_WAIT_MS = 250
_QUEUE_FRAMES = 64
_FRAMES = 150
"""Three quarters of a second, and more than the queue holds."""


class ReaderError(Exception):
    """The camera cannot be read; the message says why."""


class DeviceClock:
    """The device's milliseconds on the host's monotonic clock: the smallest delay of late is the offset between them.

    librealsense lets the device's time follow the wall clock, which NTP slews and steps. Only the newest `_FRAMES`
    frames count, so that any change is followed within a second; a step back, of which no smaller delay would tell,
    shows in a time older than that of the frame before, and is followed at once. Counted in frames, not in seconds:
    frames that waited in the queue while the host stood still would push out all that knew better.
    """

    def __init__(self) -> None:
        self._offsets_ns: Deque[int] = deque(maxlen=_FRAMES)  # noqa: UP006 - this file also runs where typing is older
        self._before_ns: Optional[int] = None  # noqa: UP045
        self.steps = 0
        """Times the device's clock went back."""
        self.step_ns = 0
        """By how much, at least, when it did so last."""

    def monotonic_ns(self, device_ms: float, arrival_ns: int) -> int:
        """Never later than the arrival, and never negative, whatever the device says."""
        if not math.isfinite(device_ms):
            return arrival_ns
        device_ns = round(device_ms * 1e6)
        if self._before_ns is not None and device_ns < self._before_ns:
            self.steps += 1
            self.step_ns = self._before_ns - device_ns
            self._offsets_ns.clear()
        self._before_ns = device_ns
        self._offsets_ns.append(arrival_ns - device_ns)
        return max(0, min(arrival_ns, device_ns + min(self._offsets_ns)))


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
        t_mono_ns=t_mono_ns,
        position_m=(p.x, p.y, p.z),
        quaternion_wxyz=(q.w, q.x, q.y, q.z),
        velocity_m_s=(v.x, v.y, v.z),
        confidence=min(3, int(pose.tracker_confidence)),
        frame=wire.PoseFrame.T265,
        session=session,
    )


class Reader:
    """Sends one datagram for each frame until stopped. Nobody listening is no error: the service may start later; a
    socket that may not be written to, or is none, is one."""

    def __init__(self, path: str, session: int) -> None:
        self._path = path
        self._session = session
        self._clock = DeviceClock()
        self._told = 0
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.sent = 0
        self.lost = 0
        self.stopped = False

    def run(self, queue: Any) -> None:
        """Raises ReaderError when frames stop, or cannot be handed on."""
        newest_ns = time.monotonic_ns()
        while not self.stopped:
            try:
                frame = queue.wait_for_frame(_WAIT_MS)
            except RuntimeError:  # none within that time
                if time.monotonic_ns() - newest_ns > _SILENT_S * 1e9:
                    raise ReaderError(f"no pose for {_SILENT_S:g} s; the camera hangs or was unplugged") from None
                continue
            newest_ns = time.monotonic_ns()
            t_ns = self._clock.monotonic_ns(frame.get_timestamp(), newest_ns)
            self._tell_steps()
            self._send(raw_pose(frame, t_ns, self._session))

    def _tell_steps(self) -> None:
        if self._clock.steps > self._told:
            if not self._told:
                step_ms = self._clock.step_ns / 1e6
                print(
                    f"t265_reader: the camera's clock stepped back by {step_ms:.1f} ms, with the host's wall clock; "
                    "followed, as any further one",
                    file=sys.stderr,
                    flush=True,
                )
            self._told = self._clock.steps

    def _send(self, pose: wire.RawPose) -> None:
        try:
            self._socket.sendto(wire.encode(pose), self._path)
            self.sent += 1
        except (BlockingIOError, ConnectionRefusedError, FileNotFoundError):
            self.lost += 1
        except OSError as error:
            raise ReaderError(f"{self._path}: poses cannot be sent there: {error.strerror or error}") from None


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
