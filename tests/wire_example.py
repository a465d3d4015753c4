"""The datagram that docs/wire.md shows byte by byte."""

from __future__ import annotations

import math

import numpy as np

from companion.neighbours import wire
from companion.neighbours.sightings import Sighting

KEY = bytes(range(32))


def example() -> wire.Datagram:
    first = [[31, -31], [0, 1], [-1, 2], [5, -5], [0, 0], [10, -20], [30, -30], [1, 1]]
    second = [[-31, 7], [3, 3], [0, 0], [0, 0], [0, 0], [0, 0], [0, 0], [-2, 2]]
    return wire.Datagram(
        role=wire.Role.BEACON,
        sender=2,
        boot_id=7 << 32 | 0x1234ABCD,
        counter=41,
        sent_ns=5_000_000_000,
        poses=wire.PoseBatch(
            np.array([4_980_000_000, 5_000_000_000]),
            np.array([[1.25, -0.5, 0.3], [1.26, -0.5, 0.3002]]),
            np.array([3, 2], np.uint8),
        ),
        csi=wire.CsiBatch(
            frame=np.array([1000, 1001], np.uint32),
            t_ns=np.array([4_990_000_000, 4_998_200_000]),
            nic_us=np.array([4_294_967_000, 7904], np.uint32),
            coefficients=np.array([first, second], np.int8),
            scale=np.array([150, 160], np.uint8),
            power_dbm=np.array([-52, -53], np.int8),
            antenna=np.array([0, 2], np.uint8),
        ),
        echo=wire.Echo(1, 4_900_000, 20_000),
        sightings=(
            Sighting(
                target=1,
                number=300,
                t_ns=3_200_000_000,
                azimuth_rad=-0.5 * math.pi,
                azimuth_std_rad=0.04,
                polar_rad=0.5 * math.pi,
                polar_std_rad=math.inf,
                range_m=3.25,
                range_std_m=0.8,
                reliability=0.6,
                fresh=0.2,
            ),
        ),
    )
