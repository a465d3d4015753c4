"""Datagrams of a neighbour, and one who takes them."""

from __future__ import annotations

import numpy as np

from companion.core.clock import NS_PER_S
from companion.neighbours import wire
from companion.neighbours.receiver import NeighbourReceiver
from tests.manual_clock import ManualClock
from wsr.reduced import reduce_channel

KEY = b"k" * 32
KEYS = (KEY,)
BASE_NS = 1_000 * NS_PER_S


def boot(number: int) -> int:
    return number << 32 | 0xABCD


def datagram(
    counter: int = 0, boot_id: int = boot(7), sender: int = 2, poses: int = 5, csi: int = 15, seed: int = 0
) -> wire.Datagram:
    rng = np.random.default_rng(seed)
    values = (rng.normal(size=(csi, 30)) + 1j * rng.normal(size=(csi, 30))).astype(np.complex64) * 30
    coefficients, scale = reduce_channel(values)
    return wire.Datagram(
        role=wire.Role.BEACON,
        sender=sender,
        boot_id=boot_id,
        counter=counter,
        sent_ns=BASE_NS + NS_PER_S // 2,
        poses=wire.PoseBatch(
            BASE_NS + np.arange(poses) * 20_000_000,
            100.0 + rng.normal(0, 0.1, (poses, 3)),
            np.full(poses, 3, np.uint8),
        ),
        csi=wire.CsiBatch(
            frame=np.arange(csi, dtype=np.uint32) + 4_294_967_290,
            t_ns=BASE_NS + np.arange(csi) * 6_000_000,
            nic_us=np.arange(csi, dtype=np.uint32) * 6000 + 4_294_900_000,
            coefficients=coefficients,
            scale=scale,
            power_dbm=np.arange(csi, dtype=np.int8) - 60,
            antenna=(np.arange(csi) % 3).astype(np.uint8),
        ),
    )


def receiver() -> NeighbourReceiver:
    return NeighbourReceiver(1, {2: "beacon"}, {2: KEYS}, ManualClock(5))
