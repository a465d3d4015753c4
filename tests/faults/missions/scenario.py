"""One mission's draw: who flies, how it is configured, what goes wrong when, and when a person asks for what."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, replace
from typing import Final

from companion.config.schema import (
    ApertureConfig,
    AutopilotConfig,
    Config,
    GateConfig,
    MissionConfig,
    PoseConfig,
)
from companion.core.messages import Vector3
from companion.study import virtual_mission

SWITCH_CHANNEL: Final = 7
MOST_S: Final = 40.0

DURATIONS_S: Final = {
    "mute": (0.2, 8.0), "deaf": (0.2, 6.0), "closed": (0.2, 4.0), "offboard": (1.0, 20.0), "commands": (1.0, 15.0),
    "parameters": (1.0, 10.0), "poses": (0.05, 12.0), "packets": (0.5, 20.0), "datagrams": (0.5, 20.0),
    "worker": (0.5, 15.0), "battery": (2.0, 60.0), "wind": (0.3, 3.0), "estimator": (0.5, 6.0),
    "recorder": (0.5, 20.0), "clock": (0.5, 20.0), "rc": (0.2, 5.0),
}  # fmt: skip
"""Faults that last, and how long. The others happen at once."""
_WORDS: Final[dict[str, tuple[str, ...]]] = {
    "mute": ("heartbeats", "telemetry", "position", "everything"), "deaf": ("",), "closed": ("",),
    "offboard": ("refuse", "silent"), "commands": ("refuse", "silent"), "parameters": ("silent", "wrong"),
    "poses": ("silent", "nan", "low", "failed", "frozen"), "packets": ("",), "datagrams": ("",),
    "worker": ("hangs", "gone", "lost", "refuses", "doubts", "lies"), "battery": ("low", "second low", "unknown",
    "silent", "second unknown"), "wind": ("",), "estimator": ("",), "recorder": ("",), "clock": ("",), "rc": ("",),
    "pause": ("loop", "process", "suspend"), "reboot": ("",), "sticks": ("",), "switch": ("",), "jump": ("",),
    "pilot": ("HOLD", "LAND", "RTL", "POSCTL", "ALTCTL", "MANUAL"), "reset": ("",), "abort": ("",), "engage": ("",),
    "stop": ("",), "kill": ("",),
}  # fmt: skip
_OFTEN: Final = {"pause": 3, "pilot": 3, "mute": 3, "abort": 2, "battery": 2, "poses": 3, "engage": 2}
_READY_S: Final = 0.9
"""Since the service began; nothing is ready any sooner."""
_LAST_S: Final = (5.0, 8.0, 8.0, 12.0, 16.0, 24.0)
"""When a mission's faults are over. An engagement begins after 1 to 2 s, a takeoff takes 5, a leg and its bearing 4."""
_NEAR_EVERY: Final = 4
"""Of so many missions one is near its target, has its faults over half a minute, and may arrive."""
CHECKS_FROM: Final = 1_000_000
"""From this seed on PX4's own arming checks fail as well. Drawn apart, so a seed below draws what it did before."""
_CHECKS: Final = ("high_accel_bias", "accel_missing", "usb_connected", "global_pos", "unexplained", "untold")
"""Checks of the mock's that fail; failing without an event that says which; no SYS_STATUS at all."""
_KINDS: Final = tuple(kind for kind in _WORDS for _ in range(_OFTEN.get(kind, 1)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """`kind` and `word` as in the tables above; `size` is a number that the kind scales as it needs it (0..1)."""

    at_s: float
    kind: str
    word: str
    for_s: float
    size: float


@dataclass(frozen=True, slots=True)
class Scenario:
    seed: int
    config: Config
    faults: tuple[Fault, ...]
    """In order of time."""
    starts_in_air: bool
    target_enu_m: Vector3
    asks_again: int
    """How often a person engages again when a flight has ended by itself."""
    rc_loss_act: int
    """COM_OBL_RC_ACT: what PX4 does when the stream is lost."""
    step_ns: int
    """In which the world goes on and the vehicle tells its place, at any phase to the control loop's 50 ms."""


def draw(seed: int) -> Scenario:
    """The same seed gives the same scenario, whatever was drawn before."""
    rng = random.Random(f"mission {seed}")
    has_switch = rng.random() < 0.4
    last_s = rng.choice(_LAST_S)
    faults = [_fault(rng, last_s) for _ in range(rng.choice((0, 1, 1, 2, 2, 3, 4, 6)))]
    faults.append(Fault(at_s=_READY_S + 0.5 * rng.random(), kind="engage", word="", for_s=0.0, size=0.0))
    if has_switch:
        faults += [Fault(at_s=_READY_S + 3.0 * rng.random(), kind="switch", word="", for_s=0.0, size=0.0)]
    bearing_rad, range_m = rng.uniform(-math.pi, math.pi), rng.uniform(2.0, 8.0)
    config = _config(rng, has_switch)
    is_near = seed % _NEAR_EVERY == _NEAR_EVERY - 1
    if is_near:
        range_m, config = rng.uniform(1.5, 3.5), _arriving(rng, config)
        faults = [fault for fault in faults if fault.kind == "engage"] + [_fault(rng, 30.0) for _ in range(2)]
    checks, may_hover = _checks(seed)
    return Scenario(
        seed=seed,
        config=config,
        faults=tuple(sorted(faults + checks, key=lambda fault: fault.at_s)),
        starts_in_air=(rng.random() < 0.6 or is_near) and may_hover,
        target_enu_m=(range_m * math.cos(bearing_rad), range_m * math.sin(bearing_rad), rng.uniform(0.0, 1.5)),
        asks_again=rng.choice((0, 1, 2)),
        rc_loss_act=rng.choice((4, 4, 4, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 3, 0)),
        step_ns=rng.choice((50_000_000, 100_000_000, 100_000_000)),
    )


def _arriving(rng: random.Random, config: Config) -> Config:
    """One that calls the target reached while it still knows little of its place: half a minute is enough."""
    mission = replace(config.mission, arrival_range_m=rng.uniform(20.0, 40.0), speed_m_s=rng.uniform(0.3, 0.5))
    return replace(config, mission=mission, aperture=ApertureConfig(length_m=1.0), gate=GateConfig())


def _fault(rng: random.Random, last_s: float) -> Fault:
    kind = rng.choice(_KINDS)
    low_s, high_s = DURATIONS_S.get(kind, (0.0, 0.0))
    for_s = low_s * (high_s / low_s) ** rng.random() if low_s else 0.0
    return Fault(
        at_s=rng.uniform(0.3, last_s), kind=kind, word=rng.choice(_WORDS[kind]), for_s=for_s, size=rng.random()
    )


def _checks(seed: int) -> tuple[list[Fault], bool]:
    """What PX4's checks find, mostly about when a person engages; and whether the vehicle may begin in the air."""
    if seed < CHECKS_FROM:
        return [], True
    rng = random.Random(f"checks {seed}")
    found = []
    for _ in range(rng.choice((1, 1, 2, 3))):
        at_s = rng.uniform(0.0, rng.choice((2.0, 2.0, 8.0, 20.0)))
        found.append(
            Fault(at_s=at_s, kind="checks", word=rng.choice(_CHECKS), for_s=0.1 * 150.0 ** rng.random(), size=0.0)
        )
    return found, rng.random() < 0.3


def _config(rng: random.Random, has_switch: bool) -> Config:
    small = rng.random() < 0.3
    half_m = rng.uniform(2.5, 6.0)
    fence = (
        GateConfig(fence_min_m=(-half_m, -half_m, -1.0), fence_max_m=(half_m, half_m, 3.5), fence_radius_m=1.2 * half_m)
        if small
        else GateConfig()
    )
    return replace(
        virtual_mission.config(),
        pose=PoseConfig(),
        aperture=ApertureConfig(length_m=rng.uniform(0.6, 1.3)),
        gate=fence,
        mission=MissionConfig(
            control="observe" if rng.random() < 0.04 else "fly",
            leave=rng.choice(("hold", "land", "return")),
            lost_target=rng.choice(("return", "land")),
            setpoints=rng.choice(("position", "velocity")),
            yaw=rng.choice(("fixed", "target")),
            takeoff_height_m=rng.uniform(1.0, 2.5),
            speed_m_s=rng.uniform(0.3, 0.9),
            limit_s=rng.choice((15.0, 900.0, 900.0)),
            hold_limit_s=rng.choice((8.0, 20.0)),
        ),
        autopilot=AutopilotConfig("none", engage_rc_channel=SWITCH_CHANNEL if has_switch else None),
    )
