"""A flight as the page's panels show it, at every moment: what a browser needs to scrub through it.

The messages of the log go through the page's own model, so that a moment of the report is what the page showed then.
"""

from __future__ import annotations

import base64
import io
import math
from typing import Any, Final

import msgspec
import numpy as np
import numpy.typing as npt
from PIL import Image

from companion.config.schema import Config
from companion.core.streams import (
    BEARING,
    COMMAND,
    CSI,
    GATE,
    HEALTH,
    MISSION,
    NEIGHBOUR,
    POSE_IN,
    PROFILE,
    SETPOINT,
    TARGET,
    VEHICLE,
    WISH,
    WORKER,
)
from companion.log.feed import introduction, shrunk
from companion.log.foxglove import power_of
from companion.log.reader import LoggedMessage
from companion.page.health import as_rows
from companion.page.model import Model
from companion.page.parts import vehicle_part

_COUNTED: Final = frozenset(stream.topic for stream in (CSI, POSE_IN, NEIGHBOUR, SETPOINT))
_SHOWN: Final = frozenset(stream.topic for stream in (BEARING, TARGET, MISSION, GATE, WISH, COMMAND, WORKER))
_TRACK_S: Final = 0.2
_COUNT_NS: Final = 1_000_000_000
_MOST_ROWS: Final = 3000
_MOST_PARTS: Final = 900
_PROFILES_BYTES: Final = 600_000
"""Of their one picture, as base64."""
_GREYS: Final = 32
"""Steps of power that a profile is kept in: what it takes less is what one can see."""


class Timeline:
    """Takes the messages of one log in their order. Times are seconds since its first."""

    def __init__(self, config: Config, source: str, wall_minus_mono_ns: int) -> None:
        self._offset_ns = wall_minus_mono_ns
        self._about = introduction(config, source)
        self._model = Model()
        self._model.take("introduction", 0, self._about)
        self._counts = dict.fromkeys(_COUNTED, 0)
        self._counted_ns: int | None = None
        self._start_ns: int | None = None
        self._track: list[list[float | None]] = []
        self._modes: list[list[Any]] = []
        self._missions: list[list[Any]] = []
        self._bearings: list[dict[str, Any]] = []
        self._targets: list[dict[str, Any]] = []
        self._refusals: list[dict[str, Any]] = []
        self._health: list[list[Any]] = []
        self._rates: list[list[Any]] = []
        self._events: list[dict[str, Any]] = []
        self._profiles: list[tuple[int, npt.NDArray[np.uint8]]] = []

    def take(self, message: LoggedMessage) -> None:
        """One message of the log."""
        t_ns, topic = message.log_time_ns - self._offset_ns, message.topic
        if self._start_ns is None:
            self._start_ns = t_ns
        if topic in _COUNTED:
            self._counts[topic] += 1
        if self._counted_ns is None or t_ns - self._counted_ns >= _COUNT_NS:
            self._counted_ns = t_ns
            self._model.take("counts", t_ns, dict(self._counts))
        if topic == VEHICLE.topic:
            self._take_vehicle(t_ns, message.data)
        elif topic == HEALTH.topic:
            self._model.take(topic, t_ns, msgspec.json.decode(message.data))
            self._note_second(t_ns)
        elif topic == PROFILE.topic and self._model.bearing is not None:
            self._profiles.append((self._model.bearing["number"], shrunk(power_of(message.data))))
        elif topic in _SHOWN:
            self._model.take(topic, t_ns, msgspec.json.decode(message.data))
            self._note_news(t_ns)

    def content(self, truth: dict[str, Any]) -> dict[str, Any]:
        """Everything, for `scrub.js`. `truth` is what `moments` knows of it."""
        return {
            "about": self._about,
            "track": _thinned(self._track, _MOST_ROWS),
            "modes": self._modes,
            "missions": self._missions,
            "bearings": _thinned(self._bearings, _MOST_PARTS),
            "refusals": _thinned(self._refusals, _MOST_PARTS),
            "targets": _thinned(self._targets, _MOST_PARTS),
            "health": self._health,
            "rates": _thinned(self._rates, _MOST_ROWS),
            "events": self._events,
            "profiles": _sprite(self._profiles),
            "truth": truth,
        }

    def _take_vehicle(self, t_ns: int, data: bytes) -> None:
        t_s = self._seconds(t_ns)
        if self._track and t_s - (self._track[-1][0] or 0.0) < _TRACK_S:
            return
        state = msgspec.json.decode(data)
        self._model.take(VEHICLE.topic, t_ns, state)
        part = vehicle_part(state, t_ns)
        place = part["p_m"] or [None, None, None]
        self._track.append([t_s, *place, part["yaw_deg"], part["battery"], part["heartbeat_age_s"]])
        mode = [part[key] for key in ("name", "mode", "armed", "in_air", "failsafe")]
        if not self._modes or self._modes[-1][1:] != mode:
            self._modes.append([t_s, *mode])

    def _note_second(self, t_ns: int) -> None:
        """Health is kept when it changes, with its words but not the figures of what is well."""
        items = as_rows(self._model.items())
        kept = [item | {"text": "well"} if item["level"] == "ok" else item for item in items]
        if not self._health or self._health[-1][1] != kept:
            self._health.append([self._seconds(t_ns), kept])
        rates = self._model.view()["rates"]
        keys = ("packets_hz", "paired_percent", "poses_hz", "datagrams_hz", "datagram_age_s", "setpoints_hz",
                "log_written", "log_dropped")  # fmt: skip
        self._rates.append([self._seconds(t_ns), *(rates[key] for key in keys)])

    def _note_news(self, t_ns: int) -> None:
        model, view = self._model, self._model.view()
        t_s = self._seconds(t_ns)
        for kept, part in (
            (self._bearings, model.bearing), (self._targets, model.target), (self._refusals, view["refusal"]),
        ):  # fmt: skip
            if part is not None and (not kept or kept[-1] != part):
                kept.append(part)
        mission = [view["mission"][key] for key in ("state", "reason", "next")]
        if not self._missions or self._missions[-1][1:] != mission:
            self._missions.append([t_s, *mission])
        new = view["events"]
        self._events += [line for line in new if not self._events or line not in self._events[-len(new) - 1 :]]

    def _seconds(self, t_ns: int) -> float:
        return round((t_ns - (self._start_ns or t_ns)) / 1e9, 2)


def _thinned(rows: list[Any], most: int) -> list[Any]:
    """Every n-th, and the last."""
    every = math.ceil(len(rows) / most)
    return rows if every <= 1 else [*rows[:-1:every], rows[-1]]


def _sprite(profiles: list[tuple[int, npt.NDArray[np.uint8]]]) -> dict[str, Any] | None:
    """All profiles below each other in one grey PNG; fewer of them where it would be too large."""
    every = 1
    while profiles:
        kept = profiles[::every]
        picture = _png(np.concatenate([cells for _, cells in kept]))
        if len(picture) <= _PROFILES_BYTES or len(kept) == 1:
            rows, columns = kept[0][1].shape
            return {"rows": rows, "columns": columns, "numbers": [number for number, _ in kept], "png": picture}
        every += 1
    return None


def _png(cells: npt.NDArray[np.uint8]) -> str:
    steps = np.rint(cells.astype(float) * ((_GREYS - 1) / 255)) * (255 / (_GREYS - 1))
    buffer = io.BytesIO()
    Image.fromarray(steps.astype(np.uint8), "L").save(buffer, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
