"""A service's status in a person's words. Pure. Azimuths from East counter-clockwise and as compass bearings, vertical
angles above the horizon, every estimate with its deviation."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

from companion.mission.table import AT_REST
from companion.page.health import HealthLook, Item, health_list
from companion.page.next_step import next_step
from companion.page.parts import compass_deg, vehicle_name

Values = Mapping[str, Any]
_S: Final = 1_000_000_000
_SILENT_S: Final = 2.0
_HARDLY_KNOWN: Final = 0.3
"""A range whose deviation is a larger share of it than this is little more than a direction."""


def person_lines(status: Values) -> Iterator[tuple[str, str]]:
    """(label, text), the most important first."""
    about, state = status["about"], str(status["state"])
    missing = status.get("not_ready", []) if state in AT_REST else []
    yield "state", f"{about['name']}: {'serving' if state == 'beacon' else state.replace('_', ' ')}"
    yield "next", next_step(state, about["control"], about["mission"], len(missing))
    if state == "beacon":
        yield from team_lines(status.get("team"))
        return
    if status["reason"]:
        yield "why", str(status["reason"])
    for number, one in enumerate(missing):
        yield "missing" if number == 0 else "", str(one)
    yield from _vehicle(status["vehicle"])
    yield "bearing", _bearing(status["bearing"], status["bearing_stale"])
    yield "target", f"{status['target_name']}: {target_words(status['target'])}"
    if status.get("camera") is not None:
        yield "leads", _leads(status["camera"])
    for robot in status["robots"]:
        if robot["id"] != status["target_id"]:
            yield "other robot", f"{robot['name']} ({robot['id']}): {target_words(robot['place'])}"
    yield from team_lines(status.get("team"))


def health_items(status: Values, free_mib: float | None) -> list[Item]:
    """The same list as the page shows, of one look."""
    vehicle = status.get("vehicle")
    packet_age_s = status.get("packet_age_s")
    silent = vehicle is not None and (packet_age_s is None or packet_age_s > _SILENT_S)
    look = HealthLook(
        known=status["about"],
        t_ns=_S,
        health=status["health"],
        vehicle=None if vehicle is None or vehicle["heartbeat_age_s"] is None else _as_message(vehicle),
        packets_hz=0.0 if silent else None,
        free_mib=free_mib,
        camera=status.get("camera"),
    )
    return health_list(look)


def target_words(target: Values | None) -> str:
    """How far the target is, and how well that is known."""
    if target is None or target["range_m"] is None:
        return "nothing known yet"
    range_m, std_m = target["range_m"], target["range_std_m"]
    known = "" if std_m is not None and std_m <= _HARDLY_KNOWN * range_m else ", its range hardly known"
    deviation = "" if std_m is None else f" ± {std_m:.1f} m"
    nearest_m, farthest_m = target["range_90_m"]
    others = target["rivals"]
    rivals = f", {others} other place{'s' if others > 1 else ''} possible" if others else ""
    held = f"{nearest_m:.0f} to {farthest_m:.0f} m with 90 %"
    sure = f"{100 * target['probability']:.0f} % sure of this place"
    return f"{range_m:.1f} m{deviation} away{known} ({held}); {sure}{rivals}"


def team_lines(team: Values | None) -> Iterator[tuple[str, str]]:
    """Where each robot of the team is from here, and by how much its axes are turned against ours; nothing where the
    team is off."""
    if team is None:
        return
    if not team["robots"]:
        yield "team", "nothing known yet" if team["age_s"] is None else "nothing new of it"
        return
    for number, (name, robot) in enumerate(team["robots"].items()):
        yield "team" if number == 0 else "", f"{name}: {_relative(robot)}"
    yield "own axes", f"{team['own_axes_deg']:+.1f}° ± {team['own_axes_std_deg']:.1f}° by all robots' North"


def _relative(robot: Values) -> str:
    if not robot["sightings"]:
        return "no bearing of it or by it"
    east_m, north_m, up_m = robot["p_own_m"]
    if not robot["placed"]:
        azimuth_deg = math.degrees(math.atan2(north_m, east_m))
        return f"not placed yet, about compass {compass_deg(azimuth_deg):.0f}°"
    place = "East {:.1f}, North {:.1f}, Up {:.1f} m".format(*(round(p, 1) + 0.0 for p in (east_m, north_m, up_m)))
    axes = f"its axes {robot['axes_deg']:+.1f}° ± {robot['axes_std_deg']:.1f}° to ours"
    return f"{place} from here, ± {robot['std_m']:.1f} m; {axes}"


def _leads(camera: Values) -> str:
    """Who says where the target is, and what the tag camera saw so far."""
    age_s = camera["frame_age_s"]
    if age_s is None:
        return f"the {camera['leads']}; no image of the tag camera yet"
    seen = f"{camera.get('believed', 0)} sightings of its tag believed in {camera['frames']} images"
    return f"the {camera['leads']}; {seen}, the newest {age_s:.1f} s ago"


def _vehicle(vehicle: Values) -> Iterator[tuple[str, str]]:
    if vehicle["system_id"] is None:
        yield "vehicle", "none heard"
        return
    where = "in the air" if vehicle["in_air"] else "on the ground"
    where = "not known whether in the air" if vehicle.get("landed_unknown") else where
    armed = "armed" if vehicle["armed"] else "disarmed"
    yield "vehicle", f"{vehicle_name(vehicle)}: {vehicle['mode'] or 'mode unknown'}, {armed}, {where}"
    battery = vehicle["battery"]
    yield "battery", "its charge is not told" if battery is None else f"{100 * battery:.0f} %"
    place, yaw_rad = vehicle["p_local_enu_m"], vehicle["yaw_enu_rad"]
    if place is None:
        yield "position", "none"
        return
    heading = "" if yaw_rad is None else f", heading {compass_deg(math.degrees(yaw_rad)):.0f}°"
    yield "position", "East {:.1f}, North {:.1f}, Up {:.1f} m".format(*(round(p, 1) + 0.0 for p in place)) + heading


def _bearing(bearing: Values | None, is_stale: bool) -> str:
    if bearing is None:
        return "none yet"
    azimuth = bearing["azimuth_deg"]
    around = "deviation not known" if bearing["azimuth_std_deg"] is None else f"± {bearing['azimuth_std_deg']:.1f}°"
    up = "elevation not observable"
    if bearing["elevation_std_deg"] is not None:
        up = f"elevation {bearing['elevation_deg']:.1f}° ± {bearing['elevation_std_deg']:.1f}°"
    stale = ", old" if is_stale else ""
    return (
        f"compass {compass_deg(azimuth):.0f}° {around} ({azimuth:.1f}° from East), {up}, "
        f"reliability {bearing['reliability']:.2f}, iteration {bearing['iteration']}{stale}"
    )


def _as_message(vehicle: Values) -> dict[str, Any]:
    """As the log has it."""
    heard_ns = _S - round(vehicle["heartbeat_age_s"] * _S)
    return dict(vehicle) | {"battery_remaining": vehicle["battery"], "heartbeat_mono_ns": heard_ns}
