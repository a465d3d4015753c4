"""What is well and what is not, worst first, each with what to do about it. Pure: by a second's counters and ages.

What is normal does not alarm: packets are asked for where a target is, an armed vehicle in flight is as it must be.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from companion.page.parts import vehicle_part

Values = Mapping[str, Any]
BAD, WARNING, OK = "bad", "warning", "ok"
_RANK: Final = {BAD: 0, WARNING: 1, OK: 2}
_HEARTBEAT_S: Final = 1.5
_BATTERY_MARGIN: Final = 0.1
_SILENT_S: Final = 3.0
_PAIRED: Final = 0.5
_CAMERA_S: Final = 2.0
_PACKETS_HZ: Final = 20.0
"""Fewer give an aperture too few packets."""


@dataclass(frozen=True, slots=True)
class Item:
    """One line of the list. `todo` is empty where nothing is to be done."""

    level: str
    name: str
    text: str
    todo: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthLook:
    """Everything the list is made of. `known` is the feed's introduction; what was never told is None or empty."""

    known: Values
    t_ns: int
    health: Values | None = None
    vehicle: Values | None = None
    worker_ready: bool | None = None
    gate: Sequence[str] = ()
    packets_hz: float | None = None
    free_mib: float | None = None
    camera: Values | None = None
    """Of the status; None where no tag camera is configured."""
    silent_s: float = 0.0
    """Since the service last said anything."""


def health_list(look: HealthLook) -> list[Item]:
    """Worst first."""
    items = [item for part in _PARTS for item in part(look)]
    return sorted(items, key=lambda item: _RANK[item.level])


def as_rows(items: Sequence[Item]) -> list[dict[str, str]]:
    return [asdict(item) for item in items]


def _service(look: HealthLook) -> Iterator[Item]:
    if look.silent_s > _SILENT_S and look.known.get("source") == "live":
        yield Item(BAD, "service", f"silent for {look.silent_s:.0f} s", "journalctl -u companion; take over")
    elif look.health is None:
        yield Item(WARNING, "service", "no health told yet", "wait a second")


def _autopilot(look: HealthLook) -> Iterator[Item]:
    if look.known.get("role") != "uav":
        return
    if look.vehicle is None:
        yield Item(BAD, "autopilot", "no word of a vehicle", "check the line and autopilot.url")
        return
    vehicle = vehicle_part(look.vehicle, look.t_ns)
    age_s = vehicle["heartbeat_age_s"]
    if age_s is None or age_s > _HEARTBEAT_S:
        silent = "no heartbeat" if age_s is None else f"no heartbeat for {age_s:.0f} s"
        yield Item(BAD, "autopilot", silent, "check the line and autopilot.url; the pilot flies")
        return
    if vehicle["failsafe"]:
        yield Item(BAD, "autopilot", "flies a failsafe of its own", "let it, or take over by the transmitter")
    elif look.vehicle.get("estimator_healthy") is False:
        yield Item(BAD, "autopilot", "its estimator is not healthy", "companion doctor autopilot; poses and GPS")
    else:
        yield Item(OK, "autopilot", f"{vehicle['name']}, mode {vehicle['mode'] or 'unknown'}")
    yield _battery(vehicle["battery"], look.known["mission"]["min_battery"])


def _battery(share: float | None, least: float) -> Item:
    if share is None:
        return Item(WARNING, "battery", "its charge is not told", "set BAT1_* so that PX4 knows it")
    text = f"{100 * share:.0f} %"
    if share < least:
        return Item(BAD, "battery", f"{text}, below {100 * least:.0f} %", "land and change it")
    if share < least + _BATTERY_MARGIN:
        return Item(WARNING, "battery", f"{text}, lands below {100 * least:.0f} %", "end the flight soon")
    return Item(OK, "battery", text)


def _poses(look: HealthLook) -> Iterator[Item]:
    if look.health is None:
        return
    age_s, poses = look.health["pose_age_s"], look.health["poses"]
    todo = "look at the camera: cable, light, texture"
    if age_s is None:
        yield Item(BAD, "poses", "none yet", "start the pose source (pose.source), check its cable")
    elif poses.get("lost"):
        yield Item(BAD, "poses", "the tracker has lost itself", todo)
    elif age_s > look.known["pose_stale_s"]:
        yield Item(BAD, "poses", f"none for {age_s:.1f} s", todo)
    elif poses.get("problem"):
        yield Item(WARNING, "poses", str(poses["problem"]), todo)
    else:
        rate = poses.get("rate_hz")
        yield Item(OK, "poses", "come" if rate is None else f"{rate:.0f} a second")


def _radio(look: HealthLook) -> Iterator[Item]:
    if look.health is None:
        return
    if look.packets_hz is not None and look.packets_hz < _PACKETS_HZ:
        text = "no packets" if look.packets_hz == 0 else f"only {look.packets_hz:.0f} packets a second"
        yield Item(BAD if look.packets_hz == 0 else WARNING, "card", text, "companion doctor radio; is the beacon on?")
    elif look.packets_hz is not None:
        yield Item(OK, "card", f"{look.packets_hz:.0f} packets a second")
    for pair in look.health.get("lookalikes", ()):
        yield Item(WARNING, "card", f"{' and '.join(pair)} look alike", "one transmitter behind both? check their MACs")
    if look.health.get("network_problem"):
        yield Item(BAD, "network", str(look.health["network_problem"]), "check the robots' interface and its address")


def _neighbours(look: HealthLook) -> Iterator[Item]:
    pairs = look.known.get("role") == "uav"  # a beacon hears pings and joins nothing
    for name, one in (look.health or {}).get("neighbours", {}).items():
        state = one["state"]
        if state == "refused":
            yield Item(BAD, name, f"refused: {one['refusal']}", "compare keys; is there a second robot of this id?")
        elif state == "unheard":
            yield Item(BAD, name, "never heard", "start it; check neighbours.broadcast, port and keys")
        elif state in ("stale", "lost"):
            yield Item(BAD, name, f"silent for {one['age_s']:.0f} s", "is it on, and within reach?")
        elif not pairs:
            yield Item(OK, name, "heard")
        elif state == "discovered":
            yield Item(WARNING, name, "its clock is not related to ours yet", "wait for shared packets")
        elif one["pairing_rate"] is not None and one["pairing_rate"] < _PAIRED:
            share = f"{100 * one['pairing_rate']:.0f} % of its packets paired"
            yield Item(WARNING, name, share, "is the air full, or the beacon's card deaf?")
        else:
            yield Item(OK, name, "tracked")


def _worker(look: HealthLook) -> Iterator[Item]:
    if look.worker_ready is False:
        yield Item(BAD, "AOA worker", "does not answer", "it is started again; the first start compiles for a minute")
    if look.gate:
        yield Item(WARNING, "gate", f"refuses: {'; '.join(look.gate)}", "docs/safety.md says what it lets pass")


def _tag_camera(look: HealthLook) -> Iterator[Item]:
    if look.camera is None:
        return
    age_s = look.camera["frame_age_s"]
    todo = "companion status; journalctl -u companion: is it plugged in, is the extra apriltag there?"
    if age_s is None or age_s > _CAMERA_S:
        silent = "no image yet" if age_s is None else f"no image for {age_s:.0f} s"
        yield Item(WARNING, "tag camera", f"{silent}; the radio leads", todo)
    else:
        yield Item(OK, "tag camera", f"the {look.camera['leads']} leads")


def _log(look: HealthLook) -> Iterator[Item]:
    recorder = (look.health or {}).get("recorder", {})
    if recorder.get("failures"):
        yield Item(WARNING, "log", f"the disk failed {recorder['failures']} times", "check the disk and recorder.path")
    if recorder.get("dropped"):
        yield Item(WARNING, "log", f"{recorder['dropped']} messages dropped", "a slow disk: this flight has no replay")
    least = look.known.get("min_free_mib", 0.0)
    if look.free_mib is not None and look.free_mib < least:
        yield Item(BAD, "disk", f"{look.free_mib:.0f} MiB free, {least:.0f} wanted", "remove old logs")
    elif recorder and not recorder.get("failures") and not recorder.get("dropped"):
        free = "" if look.free_mib is None else f", {look.free_mib / 1024:.1f} GiB free"
        yield Item(OK, "log", f"written{free}")


_PARTS: Final = (_service, _autopilot, _poses, _radio, _neighbours, _worker, _tag_camera, _log)
