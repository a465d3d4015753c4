"""One transmitter behind two names: profiles that stay the same over several apertures come from one place.

Two robots that stand apart have profiles that differ, and at the latest when somebody has moved; a robot that sends
under several identities has one profile for all of them (the paper's fingerprint). What is compared is the part of a
profile above its own mean, since far from the peaks all profiles are alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Final

import numpy as np
import numpy.typing as npt

ALIKE: Final = 0.8
"""In recordings two transmitters reach 0.08 (median of 75 pairs), at most 0.42; the two halves of the packets of one,
as two identities of it would send them, 0.998, in 26 of 28 cases more than this."""
_APERTURES: Final = 3
_KEPT: Final = 8


class Lookalikes:
    """Takes the profiles of all iterations and tells which neighbours cannot be told apart. Unless it `refuses` their
    bearings it only reports them."""

    def __init__(self, names: Mapping[int, str], refuses: bool = True) -> None:
        self._names = names
        self._refuses = refuses
        self._profiles: dict[int, dict[int, npt.NDArray[np.float32]]] = {}
        """By the start of the iteration, then by peer."""
        self._streak: dict[tuple[int, int], int] = {}
        self._until_ns = 0

    def add(self, peer: int, start_ns: int, end_ns: int, profile: bytes) -> str:
        """A profile (180, 360) as float16 bytes of an aperture between two times, empty for a refusal. Returns why
        nothing may come of this iteration, or nothing. Apertures that share packets with one that was compared are
        not: they are alike for that."""
        if len(self._names) < 2:
            return ""
        if self._profiles and start_ns not in self._profiles and start_ns < self._until_ns:
            profile = b""
        if profile:
            self._until_ns = end_ns
            others = self._profiles.setdefault(start_ns, {})
            ours = outstanding(np.frombuffer(profile, np.float16).astype(np.float32))
            for other, theirs in others.items():
                pair = (min(peer, other), max(peer, other))
                self._streak[pair] = self._streak.get(pair, 0) + 1 if likeness(ours, theirs) > ALIKE else 0
            others[peer] = ours
            while len(self._profiles) > _KEPT:
                self._profiles.pop(next(iter(self._profiles)))
        if not self._refuses:
            return ""
        twins = [name for pair in self._pairs() if peer in pair for name in pair if name != peer]
        names = ", ".join(self._names[twin] for twin in twins)
        return f"its profile cannot be told from that of {names}: one transmitter behind both?" if twins else ""

    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of the neighbours that look like one."""
        return tuple((self._names[a], self._names[b]) for a, b in self._pairs())

    def _pairs(self) -> list[tuple[int, int]]:
        known = sorted(self._names)
        return [pair for pair in combinations(known, 2) if self._streak.get(pair, 0) >= _APERTURES]


def likeness(a: npt.NDArray[np.float32], b: npt.NDArray[np.float32]) -> float:
    """Cosine of the angle between two profiles, 1 for the same."""
    return float(a @ b / max(float(np.sqrt((a @ a) * (b @ b))), 1e-12))


def outstanding(profile: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """What is above the profile's own mean: far from the peaks all profiles are alike."""
    return np.asarray(np.maximum(profile - profile.mean(), 0))
