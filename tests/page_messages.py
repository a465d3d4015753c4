"""Messages of a flight as a page's feed holds them."""

from __future__ import annotations

import math
from typing import Any

from companion.config.file import load_config
from companion.log.feed import introduction
from tests.paths import CONFIGS

S = 1_000_000_000


def known(**values: Any) -> dict[str, Any]:
    """The introduction of the demo's flying robot."""
    return introduction(load_config(CONFIGS / "demo-uav.yaml"), "live") | values


def vehicle(**values: Any) -> dict[str, Any]:
    return {
        "t_mono_ns": 100 * S,
        "heartbeat_mono_ns": 100 * S,
        "mode": "offboard",
        "armed": True,
        "in_air": True,
        "failsafe": False,
        "p_local_enu_m": [1.0, 2.0, 1.5],
        "v_local_enu_m_s": [0.1, 0.2, 0.0],
        "yaw_enu_rad": 0.0,
        "battery_remaining": 0.8,
        "estimator_healthy": True,
        "system_id": 1,
        "autopilot": "px4",
        "firmware": "1.16.1",
    } | values


def health(**values: Any) -> dict[str, Any]:
    neighbour = {
        "state": "tracked", "accepted": 9, "refused": {}, "refusal": "", "boots": 1, "age_s": 0.05, "data_age_s": 0.05,
        "pairing_rate": 0.95, "paired": 100, "clock_offset_s": 0.0, "clock_uncertainty_s": 0.0003, "round_trip_s": None,
    }  # fmt: skip
    return {
        "t_mono_ns": 100 * S,
        "radio": {"lost": 0, "samples": 10},
        "pose_age_s": 0.005,
        "poses": {"rate_hz": 199.0, "lost": False, "problem": ""},
        "neighbours": {"beacon": neighbour},
        "recorder": {"written": 1000, "dropped": 0, "malformed": 0, "failures": 0},
        "lookalikes": [],
        "network_problem": "",
    } | values


def iteration(number: int = 3, azimuth_rad: float = math.radians(-60.0), **values: Any) -> dict[str, Any]:
    estimate = {
        "azimuth_rad": azimuth_rad, "polar_rad": math.radians(95.0), "azimuth_std_rad": math.radians(2.0),
        "polar_std_rad": math.radians(3.0), "reliability": 0.8123, "azimuth_observable": True, "polar_observable": True,
        "packets": 200, "length_m": 1.2049, "alternatives": [],
        "paths": [
            {"azimuth_rad": azimuth_rad, "relative_power": 1.0}, {"azimuth_rad": 1.0, "relative_power": 0.4},
        ],
    }  # fmt: skip
    return {
        "number": number, "peer": 2, "reference_ns": 99 * S, "p_local_enu_m": [1.0, 2.0, 1.5], "estimate": estimate,
        "refusal": "",
    } | values  # fmt: skip


def target(**values: Any) -> dict[str, Any]:
    found = {
        "azimuth_rad": math.radians(-58.0), "origin_local_enu_m": [5.0, -5.0, 0.0], "range_m": 8.0, "range_std_m": 1.5,
        "probability": 0.9, "covariance_m2": [[4.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.5]],
        "rivals": [{"origin_local_enu_m": [0.0, 9.0, 0.0], "probability": 0.1}],
    }  # fmt: skip
    return {"peer": 2, "iteration": 3, "target": found | values, "p_local_enu_m": [6.0, -5.0, 0.3]}


def counts(packets: int, **values: int) -> dict[str, int]:
    return {"/csi": packets, "/pose/in": 2 * packets, "/neighbour": 0, "/setpoint": 0, "dropped": 0} | values
