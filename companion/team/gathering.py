"""What the team's process is told: places and bearings of all robots, on our clock, as they were measured.

Runs on the event loop, so it only looks at what came since the last second, and leaves most poses out.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.core.clock import NS_PER_S
from companion.core.messages import Vector3
from companion.neighbours import wire
from companion.neighbours.neighbour import Neighbour
from companion.neighbours.sightings import Sighting
from companion.team.news import News, Place
from companion.team.records import RawSighting

_EVERY_NS: Final = 200_000_000
_KEPT: Final = 256


class Gathering:
    """`own_id` and `own_boot` are this robot's."""

    def __init__(self, own_id: int, own_boot: int, neighbours: Mapping[int, Neighbour]) -> None:
        self._own = own_id, own_boot
        self._neighbours = neighbours
        self._places: deque[Place] = deque(maxlen=_KEPT)
        self._own_ns = 0
        self._sightings: deque[RawSighting] = deque(maxlen=_KEPT)
        self._looked_ns: dict[int, int] = {}
        self._placed_ns: dict[int, int] = {}

    def wants_place(self, t_ns: int) -> bool:
        return t_ns - self._own_ns >= _EVERY_NS

    def add_own_place(self, t_ns: int, p_enu_m: npt.NDArray[np.float64]) -> None:
        """Of our antenna, by our own poses (3,)."""
        self._own_ns = t_ns
        x, y, z = p_enu_m.tolist()
        self._places.append((*self._own, t_ns, (x, y, z)))

    def add_own_sighting(self, sighting: Sighting) -> None:
        """A bearing that our own aperture gave."""
        self._sightings.append(_raw(*self._own, sighting, 0))

    def news(self, now_ns: int) -> News:
        """What is new, each once."""
        for neighbour in self._neighbours.values():
            self._look(neighbour, now_ns)
        news = News(now_ns, list(self._places), list(self._sightings))
        self._places.clear()
        self._sightings.clear()
        return news

    def _look(self, neighbour: Neighbour, now_ns: int) -> None:
        """At its datagrams since the last look, the oldest first."""
        since_ns = self._looked_ns.get(neighbour.id, 0)
        new: list[wire.Datagram] = []
        for arrived_ns, datagram in reversed(neighbour.received):
            if arrived_ns <= since_ns:
                break
            new.append(datagram)
        if not new:
            return
        self._looked_ns[neighbour.id] = neighbour.received[-1][0]
        offset_ns = _offset_ns(neighbour, now_ns)
        for datagram in reversed(new):
            self._add_places(neighbour.id, datagram, offset_ns)
            for sighting in datagram.sightings:
                self._sightings.append(_raw(neighbour.id, datagram.boot_id, sighting, offset_ns))

    def _add_places(self, robot: int, datagram: wire.Datagram, offset_ns: int) -> None:
        poses = datagram.poses
        for index, t_ns in enumerate((poses.t_ns - offset_ns).tolist()):
            if abs(t_ns - self._placed_ns.get(robot, 0)) >= _EVERY_NS:
                self._placed_ns[robot] = t_ns
                x, y, z = poses.p_enu_m[index].tolist()
                place: Vector3 = (x, y, z)
                self._places.append((robot, datagram.boot_id, t_ns, place))


def _offset_ns(neighbour: Neighbour, now_ns: int) -> int:
    """Its clock less ours: by shared exchanges; where it shares none with us, by its fastest datagram of late, right to
    what that took, some milliseconds on a path where a robot goes a centimetre in twenty."""
    offset = neighbour.relation.offset(now_ns)
    if offset is not None and offset.is_locked:
        return offset.offset_ns
    late = [d.sent_ns - at for at, d in neighbour.received if now_ns - at < 10 * NS_PER_S]
    return max(late, default=neighbour.received[-1][1].sent_ns - neighbour.received[-1][0])


def _raw(observer: int, boot: int, sighting: Sighting, offset_ns: int) -> RawSighting:
    return RawSighting(
        observer=observer,
        target=sighting.target,
        number=sighting.number,
        t_ns=sighting.t_ns - offset_ns,
        azimuth_rad=sighting.azimuth_rad,
        azimuth_std_rad=sighting.azimuth_std_rad,
        polar_rad=sighting.polar_rad,
        polar_std_rad=sighting.polar_std_rad,
        range_m=sighting.range_m,
        range_std_m=sighting.range_std_m,
        reliability=sighting.reliability,
        fresh=sighting.fresh,
        boot=boot,
    )
