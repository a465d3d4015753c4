"""A pose source: any tracker whose poses are in East, North, Up. `read` stands for your library's call.

Run as `python pose_reader.py /run/companion/pose.sock`.
"""

from __future__ import annotations

import math
import socket
import sys
import time
from collections.abc import Iterator

from companion.pose.wire import PoseFrame, RawPose, encode

HIGH = 3


def read() -> Iterator[RawPose]:
    """Here: a circle of 1 m, at 50 poses a second. The time is when the pose was true, by CLOCK_MONOTONIC."""
    session = time.monotonic_ns() % 65_536  # another one whenever the tracker begins anew
    for number in range(500):
        angle = 0.5 * number / 50
        yield RawPose(
            t_mono_ns=time.monotonic_ns(),
            position_m=(math.cos(angle), math.sin(angle), 1.5),
            quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
            velocity_m_s=(-0.5 * math.sin(angle), 0.5 * math.cos(angle), 0.0),
            confidence=HIGH,
            frame=PoseFrame.ENU,
            session=session,
        )
        time.sleep(1 / 50)


def main(path: str, count: int | None = None) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.connect(path)
        for number, pose in enumerate(read()):
            if number == count:
                return
            sock.send(encode(pose))


if __name__ == "__main__":
    main(sys.argv[1])
