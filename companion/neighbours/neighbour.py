"""One robot we listen to: what it is to us now, its poses, the channels it measured, its clock on ours.

Takes datagrams that the receiver has authenticated; refuses those that cannot be, by reason.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise, starmap
from operator import itemgetter
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from companion.core.clock import NS_PER_S, age_s
from companion.neighbours import wire
from companion.neighbours.clock_relation import ClockRelation, Offset
from companion.neighbours.pairing import Pairing
from companion.neighbours.session import SenderSession

_Place = tuple[int, list[float]]
_Scalar = TypeVar("_Scalar", bound=np.generic)

_KEPT_DATAGRAMS: Final = 400
"""40 s at 10 Hz: longer than any aperture takes."""
_STALE_NS: Final = 2 * NS_PER_S
_LOST_NS: Final = 10 * NS_PER_S
_MAX_SPEED_M_S: Final = 20.0
_JUMP_M: Final = 0.5
"""What a tracker's correction may move a pose at once."""
_SETTLED: Final = 5
_US_ROUND: Final = 1 << 32
_LONGEST_ECHO_US: Final = 5_000_000


class Standing(StrEnum):
    """What a neighbour is to us now."""

    UNHEARD = "unheard"
    DISCOVERED = "discovered"
    """Authentic datagrams, but its clock is not related to ours: no exchanges are shared."""
    TRACKED = "tracked"
    STALE = "stale"
    """Nothing accepted for two seconds."""
    LOST = "lost"
    """Nothing accepted for ten seconds."""
    REFUSED = "refused"
    """What arrives in its name is not accepted; `refusal` says why."""


@dataclass(slots=True)
class Refusals:
    """Datagrams in a neighbour's name that were not accepted, by reason."""

    bad_key: int = 0
    malformed: int = 0
    replay: int = 0
    duplicate_identity: int = 0
    impossible_jump: int = 0


@dataclass(slots=True)
class Neighbour:
    """One robot we listen to and its newest datagrams with the time they arrived."""

    id: int
    name: str
    session: SenderSession = field(default_factory=lambda: SenderSession(None))
    relation: ClockRelation = field(default_factory=lambda: ClockRelation(we_ping=True))
    heard_ns: int | None = None
    accepted: int = 0
    refused: Refusals = field(default_factory=Refusals)
    refusal: str = ""
    """Why the newest refused datagram was."""
    refused_ns: int | None = None
    boots: int = 0
    counted: bool = True
    """Its driver gives frame counters."""
    received: deque[tuple[int, wire.Datagram]] = field(default_factory=lambda: deque(maxlen=_KEPT_DATAGRAMS))
    pairing: Pairing = field(init=False)
    _place: _Place | None = None
    _jumps: int = 0

    def __post_init__(self) -> None:
        self.pairing = Pairing(self.relation)

    def standing(self, now_ns: int) -> Standing:
        since_ns = None if self.heard_ns is None else now_ns - self.heard_ns
        refused = self.refused_ns is not None and now_ns - self.refused_ns < _STALE_NS
        if refused and (self.session.rivals is not None or since_ns is None or since_ns >= _STALE_NS):
            return Standing.REFUSED
        if since_ns is None:
            return Standing.UNHEARD
        if since_ns >= _LOST_NS:
            return Standing.LOST
        if since_ns >= _STALE_NS:
            return Standing.STALE
        offset = self.relation.offset(now_ns)
        return Standing.TRACKED if offset is not None and offset.is_locked else Standing.DISCOVERED

    def data_age_s(self, now_ns: int) -> float | None:
        """How long ago its newest data were measured, by its own stamps: that they were sent late shows here. None
        while the clocks are not related."""
        offset = self.relation.offset(now_ns)
        if offset is None or not offset.is_locked or not self.received:
            return None
        newest_ns = max(datagram.sent_ns for _, datagram in self.received)
        return (now_ns + offset.offset_ns - newest_ns) / NS_PER_S

    def not_locked(self, now_ns: int) -> str:
        """Why no aperture can be trusted in time; empty when the clock relation is locked."""
        offset: Offset | None = self.relation.offset(now_ns)
        if offset is None:
            return f"the clock of {self.name} is not related to ours: no shared exchanges"
        if not offset.is_locked:
            ms = offset.uncertainty_ns * 1e-6
            return f"the clock of {self.name} is not related to ours: uncertain by {ms:.1f} ms, at most 5 wanted"
        return ""

    def channels_since(self, since_ns: int) -> wire.CsiBatch:
        """All reverse channels that arrived at or after `since_ns` (our clock)."""
        return wire.joined([datagram.csi for arrived_ns, datagram in self.received if arrived_ns >= since_ns])

    def newest_pose(self) -> tuple[int, tuple[float, float, float]] | None:
        """Boot id and antenna position (ENU, its own frame) of the newest datagram with poses; None before one."""
        for _, datagram in reversed(self.received):
            if len(datagram.poses.t_ns):
                x, y, z = datagram.poses.p_enu_m[-1].tolist()
                return datagram.boot_id, (x, y, z)
        return None

    def poses(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Times (N,) on the neighbour's clock, in order, and positions (N, 3) in its North-aligned frame."""
        t_ns = _joined([d.poses.t_ns for _, d in self.received], np.int64)
        p_enu_m = np.concatenate([np.zeros((0, 3)), *(d.poses.p_enu_m for _, d in self.received)])
        order = np.argsort(t_ns, kind="stable")  # datagrams may arrive out of order
        return t_ns[order], p_enu_m[order]

    def add_forward(self, frame: int | None, t_ns: int, nic_us: int) -> None:
        """We heard a packet of it."""
        self.pairing.add_forward(frame, t_ns, nic_us)

    def relate_uncounted(self, now_ns: int) -> None:
        """Where there are no counters, once a second: relates the clocks by the times of the last seconds."""
        if not self.counted:
            since_ns = now_ns - 5 * NS_PER_S
            self.pairing.match_uncounted(self.channels_since(since_ns), since_ns)

    def refuse(self, reason: str, now_ns: int) -> None:
        self.refusal, self.refused_ns = reason, now_ns

    def file(self, datagram: wire.Datagram, now_ns: int) -> bool:
        """Takes a datagram that is authentic and new; False if what it says cannot be."""
        if self._jumps_impossibly(datagram.poses):
            self.refused.impossible_jump += 1
            self.refuse("impossible jump of its position", now_ns)
            return False
        self.heard_ns = now_ns
        self.accepted += 1
        self.counted = datagram.counted
        self.received.append((now_ns, datagram))
        self.relation.add_datagram(now_ns, datagram.sent_ns)
        self.pairing.add_reverse(datagram.csi, datagram.counted, now_ns)
        return True

    def take_echo(self, echo: wire.Echo, sent_ns: int, now_ns: int) -> None:
        """It has heard a datagram of ours. What an earlier boot of ours sent is by its age none of them."""
        since_us = (now_ns // 1000 - echo.sent_us) % _US_ROUND
        if since_us <= _LONGEST_ECHO_US:
            self.relation.add_echo((now_ns // 1000 - since_us) * 1000, sent_ns - echo.held_us * 1000)

    def restart(self) -> None:
        """Another boot has another clock: nothing of the old one can be joined with it."""
        self.boots += 1
        self.received.clear()
        self.relation.clear()
        self.pairing.clear()
        self._place, self._jumps = None, 0

    def health(self, now_ns: int) -> dict[str, Any]:
        offset = self.relation.offset(now_ns)
        return {
            "state": self.standing(now_ns),
            "accepted": self.accepted,
            "refused": {name: getattr(self.refused, name) for name in Refusals.__slots__},
            "refusal": self.refusal,
            "boots": self.boots,
            "age_s": None if self.heard_ns is None else age_s(self.heard_ns, now_ns),
            "data_age_s": self.data_age_s(now_ns),
            "pairing_rate": self.pairing.rate(now_ns),
            "paired": self.pairing.paired,
            "clock_offset_s": None if offset is None else offset.offset_ns / NS_PER_S,
            "clock_uncertainty_s": None if offset is None else offset.uncertainty_ns / NS_PER_S,
            "round_trip_s": None if offset is None or offset.round_trip_ns is None else offset.round_trip_ns / NS_PER_S,
        }

    def _jumps_impossibly(self, poses: wire.PoseBatch) -> bool:
        """Faster than any of our vehicles. A tracker that found itself again elsewhere is believed after some
        datagrams that agree, and everything before is forgotten: no aperture may span the step."""
        places = list(zip(poses.t_ns.tolist(), poses.p_enu_m.tolist(), strict=True))
        if not places:
            return False
        jumps = list(starmap(_is_jump, pairwise(places if self._place is None else [self._place, *places])))
        if any(jumps):
            self._jumps += 1
            if self._jumps < _SETTLED or any(jumps[1:]):
                return True
            self.received.clear()
        self._jumps = 0
        self._place = max(places, key=itemgetter(0))
        return False


def _is_jump(before: _Place, after: _Place) -> bool:
    allowed_m = max(_JUMP_M, _MAX_SPEED_M_S * abs(after[0] - before[0]) / NS_PER_S)
    return math.dist(before[1], after[1]) > allowed_m


def _joined(parts: list[npt.NDArray[_Scalar]], dtype: type[_Scalar]) -> npt.NDArray[_Scalar]:
    return np.concatenate([np.zeros(0, dtype), *parts])
