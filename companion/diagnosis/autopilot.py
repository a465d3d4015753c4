"""`companion doctor autopilot`: which vehicle there is, and whether its parameters are what `engage` wants."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import Any

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.autopilot.port import AutopilotError
from companion.config.schema import AutopilotConfig, Config
from companion.core.clock import MonotonicClock
from companion.core.messages import VehicleState
from companion.errors import ConfigError
from companion.flight.status import vehicle_name
from companion.radio.checks import Check
from companion.safety.preflight import (
    EXPECTED,
    Heights,
    Requirement,
    other_vehicle,
    parameter_problems,
    required_parameters,
)
from companion.signing.autopilot import SignedAutopilot, signing_relay

_VERSION_S = 3.0
_LOOK_S = 0.05
_STOP = "systemctl stop companion, then companion doctor autopilot"


async def autopilot_checks(config: Config, seconds: float, status: dict[str, Any] | None = None) -> list[Check]:
    """Commands nothing. `status` is what a running service says of itself: it holds the link then. Raises ConfigError
    where the configuration has no autopilot."""
    if config.autopilot is None:
        raise ConfigError(f"role {config.role}: there is no autopilot to look at")
    if status is not None:
        return [_of_service(status), Check("parameters", None, "the running service holds the link", _STOP)]
    try:
        async with _connected(config, config.autopilot, seconds) as edge:
            return [
                _vehicle(edge.state(), config.mission.vehicle),
                _arming(edge.state()),
                *await _parameters(config, config.autopilot.gps, edge),
            ]
    except AutopilotError as error:
        taken = "is the service running? companion status names its vehicle" if "taken" in str(error) else ""
        return [Check("vehicle", False, str(error), taken)]


def _of_service(status: dict[str, Any]) -> Check:
    vehicle = status.get("vehicle") or {}
    if vehicle.get("system_id") is None:
        return Check("vehicle", False, "the running service hears none", "is it on, and its MAVLink at this URL?")
    named = f"system {vehicle['system_id']}, {vehicle.get('autopilot') or 'unknown'} {vehicle.get('firmware') or ''}"
    return Check("vehicle", True, f"the running service has {named.strip()}")


@contextlib.asynccontextmanager
async def _connected(whole: Config, config: AutopilotConfig, seconds: float) -> AsyncIterator[MavsdkAutopilot]:
    """With the firmware's version and what its arming checks say, where the vehicle tells them."""
    relay = signing_relay(whole)
    edge = MavsdkAutopilot(relay.url if relay else config.url, MonotonicClock(), system_id=config.system_id)
    link = SignedAutopilot(edge, relay) if relay else edge
    try:
        await link.connect(seconds)
    except BaseException:
        await link.aclose()
        raise
    watch = asyncio.create_task(edge.watch())
    try:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_VERSION_S):
                while not edge.state().firmware or edge.state().can_arm is False:  # noqa: ASYNC110 - it is polled
                    await asyncio.sleep(_LOOK_S)
        yield edge
    finally:
        watch.cancel()
        await link.aclose()


def _vehicle(state: VehicleState, vehicle: str) -> Check:
    if state.autopilot == EXPECTED[vehicle]:
        return Check("vehicle", True, vehicle_name(state))
    return Check(
        "vehicle", False, other_vehicle(state.autopilot, vehicle), "autopilot.system_id says which one is ours"
    )


def _arming(vehicle: VehicleState) -> Check:
    """Not judged: without GPS they pass only while the service sends poses."""
    if vehicle.can_arm is False:
        why = "; ".join(vehicle.arming_reasons) or "it has not said why"
        return Check("arming checks", True, f"PX4's own fail now: {why}; engage refuses until they pass")
    return Check("arming checks", True, "PX4's own pass" if vehicle.can_arm else "this firmware does not tell of them")


async def _parameters(config: Config, gps: bool, edge: MavsdkAutopilot) -> list[Check]:
    """One line for each, with its value."""
    values: dict[str, float | str] = {}
    vehicle = config.mission.vehicle
    for requirement in required_parameters(gps, vehicle):
        try:
            values[requirement.name] = await edge.parameter(requirement.name)
        except AutopilotError as error:
            values[requirement.name] = str(error)
    heights = Heights(config.mission.takeoff_height_m, config.gate.fence_max_m[2])
    problems = list(parameter_problems(values, gps, heights, vehicle))
    required = required_parameters(gps, vehicle)
    return [_parameter(requirement, values[requirement.name], problems) for requirement in required]


def _parameter(requirement: Requirement, value: float | str, problems: list[str]) -> Check:
    name = requirement.name
    wrong = next((problem for problem in problems if problem.split()[1] == name), None)
    if isinstance(value, str):
        return Check(name, False, value, f"wanted {requirement.wanted}: {requirement.why}")
    if wrong is None:
        return Check(name, True, f"{value:g}")
    return Check(name, False, f"{value:g}; wanted {requirement.wanted}: {requirement.why}",
                 "set it at the ground station, or load configs/px4 (companion config example gps)")  # fmt: skip
