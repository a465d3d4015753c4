"""A T265 of librealsense's software device in front of the camera's reader (standard library and pyrealsense2 only).

    python -m tests.faults.software_t265 --socket SOCKET --frames N [--record FILE.bag] [--silent]

Feeds N poses at 200 Hz: 1 mm to the camera's right each time, every tenth one NaN. With --silent it then feeds nothing,
and the reader must end by itself.
"""

from __future__ import annotations

import argparse
import math
import sys
import threading
import time
from typing import Any

import pyrealsense2 as rs

from companion.pose.t265_reader import Reader, ReaderError, open_pose_sensor

RATE_HZ = 200


def software_camera() -> tuple[Any, Any, Any]:
    """Device, sensor and stream profile."""
    device = rs.software_device()
    sensor = device.add_sensor("Tracking Module")
    stream = rs.pose_stream()
    stream.type, stream.index, stream.uid, stream.fps = rs.stream.pose, 0, 1, RATE_HZ
    stream.fmt = rs.format.six_dof
    return device, sensor, sensor.add_pose_stream(stream)


def _vector(x: float, y: float, z: float) -> Any:
    made = rs.vector()
    made.x, made.y, made.z = x, y, z
    return made


def software_frame(number: int, profile: Any) -> Any:
    """A new frame each time: one that is used twice is freed twice."""
    pose = rs.pose()
    lost = number % 10 == 9
    pose.translation = _vector(math.nan if lost else 0.001 * number, 2.0, 3.0)
    pose.velocity = _vector(0.2, 0.0, 0.0)
    rotation = rs.quaternion()
    rotation.x, rotation.y, rotation.z, rotation.w = 0.0, 0.0, 0.0, 1.0
    pose.rotation = rotation
    pose.tracker_confidence = 3
    frame = rs.software_pose_frame()
    frame.data = pose
    frame.timestamp = time.time() * 1000
    frame.domain = rs.timestamp_domain.system_time
    frame.frame_number = number
    frame.profile = profile.as_pose_stream_profile()
    return frame


def _feed(sensor: Any, profile: Any, count: int, reader: Reader, silent: bool) -> None:
    start = time.monotonic()
    for number in range(count):
        sensor.on_pose_frame(software_frame(number, profile))
        time.sleep(max(0.0, start + (number + 1) / RATE_HZ - time.monotonic()))
    if not silent:
        time.sleep(0.3)
        reader.stopped = True


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--socket", required=True)
    parser.add_argument("--frames", type=int, required=True)
    parser.add_argument("--record", default="")
    parser.add_argument("--silent", action="store_true")
    arguments = parser.parse_args()
    device, sensor, profile = software_camera()
    source = rs.recorder(arguments.record, device) if arguments.record else device
    opened, queue = open_pose_sensor(rs, source)
    reader = Reader(arguments.socket, session=7)
    feeding = threading.Thread(
        target=_feed, args=(sensor, profile, arguments.frames, reader, arguments.silent), daemon=True
    )
    feeding.start()
    try:
        reader.run(queue)
    except ReaderError as error:
        print(error, file=sys.stderr)
        return 1
    finally:
        opened.stop()
        opened.close()
    print(reader.sent, reader.lost)
    return 0


if __name__ == "__main__":
    sys.exit(main())
