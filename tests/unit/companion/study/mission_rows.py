"""Missions of a study, made by hand."""

from __future__ import annotations

from typing import Any

from companion.study.belief import BeliefCheck
from companion.study.rendezvous_rows import FlownIteration, MissionRow


def step(number: int, paper_deg: float | None = 4.0, **changes: Any) -> FlownIteration:
    """One each five seconds, of a robot that stands. Without a bound: to rank bounds takes a second of imports."""
    values: dict[str, Any] = {
        "number": number, "time_s": 5.0 * number, "distance_m": 9.0, "beacon_moving": False, "azimuth_deg": 1.0,
        "paper_deg": paper_deg, "great_circle_deg": paper_deg, "crb_deg": None, "informativeness_deg": 0.3,
        "reliability": 0.8, "refusal": "", "belief": BeliefCheck(3.0, True, True),
    }  # fmt: skip
    return FlownIteration(**values | changes)


def mission(scene: str = "hall", number: int = 0, **changes: Any) -> MissionRow:
    """One that arrives after 40 s, 1.5 m from the robot."""
    values: dict[str, Any] = {
        "scene": scene, "number": number, "time_s": 40.0, "straight_s": 30.0, "end": "arrived", "closest_m": 1.4,
        "reached_s": 35.0, "arrived_m": 1.5, "left_room": False, "draws_truths": False,
        "steps": [step(n) for n in range(9)],
    }  # fmt: skip
    return MissionRow(**values | changes)
