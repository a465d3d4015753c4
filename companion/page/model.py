"""What a page knows: the messages of a feed, kept as the pictures need them. No I/O; times are the feed's own.

`view` is small and changes all the time; `path` and `profile` are larger and change now and then.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from companion.flight.records import SERVICE_ENDS
from companion.mission.table import AT_REST
from companion.page import parts
from companion.page.health import HealthLook, Item, as_rows, health_list
from companion.page.next_step import ENDED, next_step

_TRAIL: Final = 1500
_TRAIL_STEP_M: Final = 0.1
_BEARINGS: Final = 200
_EVENTS: Final = 30
_RATE_OVER_S: Final = 2.0
_RESTART_S: Final = 5.0
"""A clock that falls back by more is another flight's."""
Data = Mapping[str, Any]


class Model:
    """Takes messages in their order."""

    def __init__(self) -> None:
        self.known: Data = {}
        """The feed's introduction; empty before it."""
        self.version = self.path_version = self.profile_version = 0
        """Counted up when what they are of has changed."""
        self.free_mib: float | None = None
        """On the log's disk, told by whoever looks at it."""
        self._forget()

    def take(self, topic: str, t_ns: int, data: Any) -> None:
        """One message of the feed. One of a topic that is not shown is passed over."""
        if t_ns < self._t_ns - _RESTART_S * 1e9 and topic == "counts":
            self._forget()
        taker = self._takers.get(topic)
        if taker is not None:
            taker(t_ns, data)
            self.version += 1

    def look(self, silent_s: float = 0.0) -> HealthLook:
        """What the health list is made of."""
        return HealthLook(
            known=self.known,
            t_ns=self._t_ns,
            health=self.health,
            vehicle=self.vehicle,
            worker_ready=self._worker_ready,
            gate=self._gate,
            packets_hz=self.rate("/csi"),
            free_mib=self.free_mib,
            camera=self._status.get("camera"),
            silent_s=silent_s,
        )

    def items(self, silent_s: float = 0.0) -> list[Item]:
        """Nothing of a recording: it is well as it is."""
        return health_list(self.look(silent_s)) if self.known and self.known["role"] != "recording" else []

    def view(self, silent_s: float = 0.0) -> dict[str, Any]:
        """What changes all the time, as plain values. `silent_s` has passed since the service last said anything."""
        known = self.known
        return {
            "introduced": bool(known),
            "name": known.get("name", ""),
            "role": known.get("role", ""),
            "source": known.get("source", ""),
            "ended": self._ended,
            "silent_s": round(silent_s, 1),
            "t_s": self._seconds(self._t_ns),
            "fence": known.get("fence"),
            "vehicle": None if self.vehicle is None else parts.vehicle_part(self.vehicle, self._t_ns),
            "mission": self._mission(),
            "bearing": self.bearing,
            "refusal": self._refusal,
            "target": self.target,
            "target_name": self._name(self._aimed_at),
            "robots": [
                {"id": peer, "name": name, "place": self._places.get(peer)}
                for peer, name in self.known.get("peers", {}).items()
            ],
            "health": as_rows([] if self._ended else self.items(silent_s)),
            "rates": self._rates(),
            "events": list(self._events),
        }

    def path(self) -> dict[str, Any]:
        """Where the vehicle has been, and its bearings so far."""
        return {"trail": list(self._trail), "bearings": list(self._bearings)}

    def rate(self, topic: str) -> float | None:
        """Messages a second by the feed's own clock; None before two counts."""
        if len(self._counts) < 2:
            return None
        (first_ns, first), (last_ns, last) = self._counts[0], self._counts[-1]
        if last_ns <= first_ns:
            return None
        return float((last.get(topic, 0) - first.get(topic, 0)) / ((last_ns - first_ns) / 1e9))

    @property
    def counts(self) -> Data:
        """Messages since the feed began, by topic; empty before the first count."""
        return self._counts[-1][1] if self._counts else {}

    @property
    def target(self) -> dict[str, Any] | None:
        """What is known of where the robot is that is flown to."""
        return self._places.get(self._aimed_at or next(iter(self._places), ""))

    @property
    def state(self) -> str:
        """Of the mission; empty before anything is known."""
        return self._state

    def _forget(self) -> None:
        """Another flight begins."""
        self.path_version += 1
        self.profile_version += 1
        self.profile: Data | None = None
        self._t_ns = 0
        self._start_ns: int | None = None
        self._ended = False
        self.vehicle: Data | None = None
        self.health: Data | None = None
        self._status: Data = {}
        self._worker_ready: bool | None = None
        self._gate: list[str] = []
        self._state = ""
        self._reason = ""
        self._state_ns = 0
        self.bearing: dict[str, Any] | None = None
        self._refusal: dict[str, Any] | None = None
        self._places: dict[str, dict[str, Any]] = {}
        """By peer: the newest that a bearing of it made of where it is."""
        self._aimed_at: str | None = None
        """The robot that is flown to; None before anything is known of that."""
        self._trail: deque[list[float]] = deque(maxlen=_TRAIL)
        self._bearings: deque[list[float]] = deque(maxlen=_BEARINGS)
        self._events: deque[dict[str, Any]] = deque(maxlen=_EVENTS)
        self._counts: deque[tuple[int, Data]] = deque()
        self._takers: dict[str, Callable[[int, Any], None]] = {
            "introduction": self._take_introduction,
            "status": self._take_status,
            "counts": self._take_counts,
            "end of log": self._take_end,
            "/vehicle": self._take_vehicle,
            "/health": self._take_health,
            "/mission": self._take_mission,
            "/bearing": self._take_bearing,
            "/target": self._take_target,
            "/aoa/profile": self._take_profile,
            "/aoa/worker": self._take_worker,
            "/gate": self._take_gate,
            "/wish": self._take_wish,
            "/command": self._take_command,
            "/autopilot_event": lambda t_ns, data: self._tell(t_ns, "vehicle", data["text"]),
            "/log": lambda t_ns, data: self._tell(t_ns, "log", data["text"]),
        }

    def _take_introduction(self, t_ns: int, data: Data) -> None:
        self.known = data
        if self._aimed_at is None and "target" in data:
            self._aimed_at = str(data["target"])
        self._state = data["role"] if data["role"] != "uav" else self._state or "idle"

    def _take_status(self, t_ns: int, data: Data) -> None:
        self._status = data
        if "target_id" in data:
            self._aim_at(str(data["target_id"]))
        self._state, self._reason = str(data.get("state", self._state)), str(data.get("reason", self._reason))

    def _take_counts(self, t_ns: int, data: Data) -> None:
        if self._counts and t_ns <= self._counts[-1][0]:
            return
        self._t_ns = t_ns
        self._start_ns = self._start_ns or t_ns or None
        self._counts.append((t_ns, data))
        while len(self._counts) > 2 and self._counts[1][0] <= t_ns - _RATE_OVER_S * 1e9:
            self._counts.popleft()

    def _take_end(self, t_ns: int, data: Any) -> None:
        self._ended = True

    def _take_vehicle(self, t_ns: int, data: Data) -> None:
        self.vehicle = data
        place = data.get("p_local_enu_m")
        if place is None:
            return
        if not self._trail or math.dist(self._trail[-1][:2], place[:2]) >= _TRAIL_STEP_M:
            self._trail.append([round(value, 2) for value in place])
            self.path_version += 1

    def _take_health(self, t_ns: int, data: Data) -> None:
        self.health = data

    def _take_mission(self, t_ns: int, data: Data) -> None:
        # The table takes an end of the service for a fault, since nobody acts any more; a person has stopped it.
        state = ENDED if data["reason"] == SERVICE_ENDS else data["next_state"]
        if state != self._state:
            self._state_ns = t_ns
        self._state, self._reason = state, data["reason"]
        self._tell(t_ns, "mission", f"{data['state']} to {state}: {data['reason'] or data['event']}")

    def _take_bearing(self, t_ns: int, data: Data) -> None:
        if self._aimed_at not in (None, str(data["peer"])):
            return
        found = parts.bearing_part(data, self._seconds(t_ns))
        if found is None:
            self._refusal = parts.refusal_part(data, self._seconds(t_ns))
            return
        self._refusal = None
        if self.bearing is not None and self.bearing["number"] == found["number"]:
            return
        self.bearing = found
        if found["p_m"] is not None:
            self._bearings.append([*found["p_m"][:2], found["azimuth_deg"], found["reliability"]])
            self.path_version += 1

    def _take_target(self, t_ns: int, data: Data) -> None:
        self._places[str(data["peer"])] = parts.target_part(data, self._seconds(t_ns))

    def _take_profile(self, t_ns: int, data: Data) -> None:
        self.profile = data
        self.profile_version += 1

    def _take_worker(self, t_ns: int, data: Data) -> None:
        self._worker_ready = bool(data["is_ready"])

    def _take_gate(self, t_ns: int, data: Data) -> None:
        self._gate = list(data["reasons"])
        self._tell(t_ns, "gate", "refuses: " + "; ".join(self._gate) if self._gate else "passes again")

    def _take_wish(self, t_ns: int, data: Data) -> None:
        refusal = f", refused: {data['refusal']}" if data["refusal"] else ""
        named = data.get("target")
        to = "" if named is None else f" to {self._name(str(named))}"
        self._tell(t_ns, "wish", f"{data['wish']}{to}{refusal}")
        if named is not None and not data["refusal"]:
            self._aim_at(str(named))

    def _aim_at(self, peer: str) -> None:
        """Bearings of the one before are none of this robot."""
        if self._aimed_at not in (None, peer):
            self.bearing = self._refusal = None
            self._bearings.clear()
            self.path_version += 1
        self._aimed_at = peer

    def _name(self, peer: str | None) -> str:
        return str(self.known.get("peers", {}).get(peer, peer or ""))

    def _take_command(self, t_ns: int, data: Data) -> None:
        if data["error"]:
            self._tell(t_ns, "command", data["error"])

    def _tell(self, t_ns: int, kind: str, text: str) -> None:
        line = {"t_s": self._seconds(t_ns), "kind": kind, "text": text}
        if line not in self._events:
            self._events.append(line)

    def _mission(self) -> dict[str, Any] | None:
        if not self.known:
            return None
        missing = list(self._status.get("not_ready", ())) if self._state in AT_REST else []
        return {
            "state": self._state,
            "reason": self._reason,
            "since_s": round((self._t_ns - self._state_ns) / 1e9, 1) if self._state_ns else None,
            "control": self.known["control"],
            "next": next_step(self._state, self.known["control"], self.known["mission"], len(missing)),
            "not_ready": missing,
        }

    def _rates(self) -> dict[str, Any]:
        health = self.health or {}
        pairing = [one["pairing_rate"] for one in health.get("neighbours", {}).values()]
        recorder = health.get("recorder", {})
        return {
            "packets_hz": _tenth(self.rate("/csi")),
            "poses_hz": _tenth(self.rate("/pose/in")),
            "datagrams_hz": _tenth(self.rate("/neighbour")),
            "setpoints_hz": _tenth(self.rate("/setpoint")),
            "paired_percent": max((round(100 * one) for one in pairing if one is not None), default=None),
            "datagram_age_s": min(
                (round(one["age_s"], 1) for one in health.get("neighbours", {}).values() if one["age_s"] is not None),
                default=None,
            ),
            "log_written": recorder.get("written"),
            "log_dropped": recorder.get("dropped"),
            "disk_free_gib": None if self.free_mib is None else round(self.free_mib / 1024, 1),
        }

    def _seconds(self, t_ns: int) -> float:
        return round((t_ns - (self._start_ns or t_ns)) / 1e9, 2)


def _tenth(value: float | None) -> float | None:
    return None if value is None else round(value, 1)
