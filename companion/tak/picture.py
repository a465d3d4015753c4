"""What of a feed TAK is told: where the vehicle is, the target where it is known, a wedge where only its direction is.
Pure; times of messages are the feed's own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from companion.core.clock import age_s
from companion.core.messages import Vector3
from companion.tak.events import (
    DRONE,
    ELLIPSE,
    FUSED,
    GPS,
    SENSOR,
    UNKNOWN_GROUND,
    UNKNOWN_M,
    CotEvent,
    ellipse_95,
    sensor,
)
from companion.tak.geodesy import Place, beside

Data = Mapping[str, Any]

_GPS_OLD_S: Final = 3.0
_TARGET_OLD_S: Final = 15.0
_BEARING_OLD_S: Final = 10.0
_LIKELY: Final = 0.5
_KNOWN_SHARE: Final = 0.3
"""A target whose range is known worse is told as a direction."""
_WEDGE_STDS: Final = 1.96


@dataclass(frozen=True, slots=True, kw_only=True)
class Telling:
    """`uid` begins the identifiers of all events; `wedge_m` is how long a wedge is drawn."""

    uid: str
    callsign: str
    wedge_m: float
    stale_s: float


class Picture:
    """Takes messages in their order; `events` are due now."""

    def __init__(self, telling: Telling) -> None:
        self._telling = telling
        self._known: Data = {}
        self._newest: dict[str, tuple[int, Data]] = {}
        self._t_ns = 0
        self._aimed_at: int | None = None
        """The robot that is flown to: a person may name another one in flight."""

    def take(self, topic: str, t_ns: int, data: Data) -> None:
        if topic == "introduction":
            self._known, self._newest, self._aimed_at = data, {}, data.get("target")
        elif topic == "status" and "target_id" in data:
            self._aim_at(int(data["target_id"]))
        elif topic in ("/vehicle", "/target", "/bearing", "/mission"):
            if topic in ("/target", "/bearing") and data.get("peer") != self._aimed_at:
                return
            if topic == "/bearing" and data["estimate"] is None:
                return
            self._newest[topic] = t_ns, data
        self._t_ns = max(self._t_ns, t_ns)

    def _aim_at(self, peer: int) -> None:
        """What was told of the robot before is none of this one."""
        if peer != self._aimed_at:
            self._aimed_at = peer
            for topic in ("/target", "/bearing"):
                self._newest.pop(topic, None)

    def events(self) -> list[CotEvent]:
        """None without a fix of our own: everything else is told from there."""
        here = self._here()
        if here is None:
            return []
        place, local_m, own = here
        target = self._target(place, local_m)
        return [own, *(target or self._wedge(place, local_m))]

    def _age_s(self, t_ns: int) -> float:
        return age_s(t_ns, self._t_ns)

    def _here(self) -> tuple[Place, Vector3 | None, CotEvent] | None:
        vehicle = self._newest.get("/vehicle")
        gps = None if vehicle is None else vehicle[1].get("gps")
        if vehicle is None or gps is None or self._age_s(gps["t_mono_ns"]) > _GPS_OLD_S:
            return None
        state, telling = vehicle[1], self._telling
        place = Place(gps["latitude_deg"], gps["longitude_deg"], gps["hae_m"])
        details = [
            ("contact", {"callsign": telling.callsign}, ""),
            ("precisionlocation", {"geopointsrc": "GPS", "altsrc": "GPS"}, ""),
            ("remarks", {}, self._remarks(state)),
        ]
        if state["v_local_enu_m_s"] is not None and state["yaw_enu_rad"] is not None:
            east, north, _ = state["v_local_enu_m_s"]
            course = _compass_deg(math.atan2(north, east)) if math.hypot(east, north) > 0.2 else None
            course = _compass_deg(state["yaw_enu_rad"]) if course is None else course
            details.insert(1, ("track", {"course": f"{course:.1f}", "speed": f"{math.hypot(east, north):.2f}"}, ""))
        own = CotEvent(
            uid=telling.uid,
            kind=DRONE,
            how=GPS,
            place=place,
            ce_m=UNKNOWN_M if gps["horizontal_m"] is None else gps["horizontal_m"],
            le_m=UNKNOWN_M if gps["vertical_m"] is None else gps["vertical_m"],
            stale_s=telling.stale_s,
            details=details,
        )
        local = state["p_local_enu_m"]
        return place, None if local is None else (local[0], local[1], local[2]), own

    def _remarks(self, state: Data) -> str:
        mission = self._newest.get("/mission")
        flying = "in the air" if state["in_air"] else "on the ground"
        flying = "not known whether in the air" if state.get("landed_unknown") else flying
        told = mission[1].get("state", "") if mission is not None else ""
        return f"{flying}, {str(told).replace('_', ' ')}" if told else flying

    def _target(self, here: Place, local_m: Vector3 | None) -> list[CotEvent]:
        """Where it is, with the ellipse that holds 95 %; nothing while that is not known."""
        told = self._newest.get("/target")
        if told is None or local_m is None or self._age_s(told[0]) > _TARGET_OLD_S:
            return []
        report, target = told[1], told[1]["target"]
        range_m, std_m = target["range_m"], target["range_std_m"]
        if std_m is None or std_m > _KNOWN_SHARE * range_m or target["probability"] < _LIKELY:
            return []
        covariance = np.array(target["covariance_m2"], float)
        if not np.all(np.isfinite(covariance[:2, :2])):
            return []
        place = beside(here, _minus(report["p_local_enu_m"], local_m))
        ellipse = ellipse_95(covariance)
        name = self._name()
        level_m = math.sqrt(0.5 * float(covariance[0, 0] + covariance[1, 1]))
        sure = f"{range_m:.1f} m ± {std_m:.1f} m away, {100 * target['probability']:.0f} % sure of this place"
        uid, stale_s = f"{self._telling.uid}.target", self._telling.stale_s
        height_m = math.sqrt(float(covariance[2, 2]))
        marker = CotEvent(
            uid=uid, kind=UNKNOWN_GROUND, how=FUSED, place=place, stale_s=stale_s, ce_m=level_m, le_m=height_m,
            details=[("contact", {"callsign": name}, ""), ("remarks", {}, sure), self._link()],
        )  # fmt: skip
        around = CotEvent(
            uid=f"{uid}.ellipse", kind=ELLIPSE, how=FUSED, place=place, stale_s=stale_s, ce_m=level_m, le_m=height_m,
            ellipse=ellipse,
            details=[("contact", {"callsign": f"{name} 95 %"}, ""), ("remarks", {}, sure)],
        )  # fmt: skip
        return [marker, around]

    def _wedge(self, here: Place, local_m: Vector3 | None) -> list[CotEvent]:
        """From where the newest bearing was taken."""
        told = self._newest.get("/bearing")
        if told is None or local_m is None or self._age_s(told[0]) > _BEARING_OLD_S:
            return []
        bearing, estimate = told[1], told[1]["estimate"]
        std_rad = estimate["azimuth_std_rad"]
        if bearing["p_local_enu_m"] is None or std_rad is None or not estimate["azimuth_observable"]:
            return []
        width_deg = math.degrees(2 * _WEDGE_STDS * std_rad)
        azimuth_deg, name = _compass_deg(estimate["azimuth_rad"]), self._name()
        said = f"{azimuth_deg:.0f}° ± {math.degrees(std_rad):.1f}°, reliability {estimate['reliability']:.2f}"
        event = CotEvent(
            uid=f"{self._telling.uid}.bearing",
            kind=SENSOR,
            how=FUSED,
            place=beside(here, _minus(bearing["p_local_enu_m"], local_m)),
            stale_s=self._telling.stale_s,
            details=[
                ("contact", {"callsign": f"bearing of {name}"}, ""),
                sensor(azimuth_deg, width_deg, self._telling.wedge_m),
                ("remarks", {}, said),
                self._link(),
            ],
        )
        return [event]

    def _link(self) -> tuple[str, Mapping[str, str], str]:
        """Who says so."""
        return "link", {"uid": self._telling.uid, "type": DRONE, "relation": "p-p"}, ""

    def _name(self) -> str:
        return str(self._known.get("peers", {}).get(str(self._aimed_at), "target"))


def _compass_deg(azimuth_rad: float) -> float:
    return (90.0 - math.degrees(azimuth_rad)) % 360.0


def _minus(a: Vector3, b: Vector3) -> Vector3:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
