"""Bytes with a few of them flipped, inserted or removed."""

from __future__ import annotations

import random


def mutant(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.randint(1, 3)):
        if not changed:
            break
        at = rng.randrange(len(changed))
        action = rng.randrange(3)
        if action == 0:
            changed[at] ^= 1 << rng.randrange(8)
        elif action == 1:
            changed.insert(at, rng.randrange(256))
        else:
            del changed[at]
    return bytes(changed)
