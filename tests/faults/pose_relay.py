"""A camera reader with faults: passes the world's poses to the service as its own child process.

    python -m tests.faults.pose_relay --from SOCKET --to SOCKET --orders SOCKET

Orders, one text datagram each: pass | nan | pause | jump METRES
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import select
import socket
from pathlib import Path

from companion.host.unix_datagram import bind_datagram_socket
from companion.pose import wire


def _spoilt(pose: wire.RawPose, order: str, offset_m: float) -> wire.RawPose | None:
    if order == "pause":
        return None
    if order == "nan":
        return pose._replace(position_m=(math.nan, math.nan, math.nan))
    x, y, z = pose.position_m
    return pose._replace(position_m=(x + offset_m, y, z))


def main() -> None:
    parser = argparse.ArgumentParser()
    for name in ("from", "to", "orders"):
        parser.add_argument(f"--{name}", required=True)
    paths = vars(parser.parse_args())
    session = int.from_bytes(os.urandom(2), "little")
    order, offset_m = "pass", 0.0
    out = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    with bind_datagram_socket(Path(paths["from"])) as world, bind_datagram_socket(Path(paths["orders"])) as orders:
        while True:
            readable, _, _ = select.select([world, orders], [], [])
            if orders in readable:
                order, _, argument = orders.recv(256).decode().partition(" ")
                offset_m += float(argument or 0.0)
            if world in readable:
                pose = _spoilt(wire.decode(world.recv(256)), order, offset_m)
                if pose is not None:
                    with contextlib.suppress(OSError):
                        out.sendto(wire.encode(pose._replace(session=session)), paths["to"])


if __name__ == "__main__":
    main()
