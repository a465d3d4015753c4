"""`companion doctor autopilot`: which vehicle there is, and whether its parameters are what `engage` wants."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.autopilot.port import AutopilotError
from companion.config.schema import AutopilotConfig, Config
from companion.core.clock import MonotonicClock
from companion.core.messages import VehicleState
from companion.errors import ConfigError
from companion.flight.status import vehicle_name
from companion.radio.checks import Check
from companion.safety.preflight import Heights, other_vehicle, parameter_problems, required_parameters

_VERSION_S = 3.0
_LOOK_S = 0.05


async def autopilot_checks(config: Config, seconds: float) -> list[Check]:
    """Commands nothing. Raises ConfigError where the configuration has no autopilot."""
    if config.autopilot is None:
        raise ConfigError(f"role {config.role}: there is no autopilot to look at")
    try:
        async with _connected(config.autopilot, seconds) as edge:
            return [
                _vehicle(edge.state()),
                _arming(edge.state()),
                *await _parameters(config, config.autopilot.gps, edge),
            ]
    except AutopilotError as error:
        taken = "is the service running? companion status names its vehicle" if "taken" in str(error) else ""
        return [Check("vehicle", False, str(error), taken)]


@contextlib.asynccontextmanager
async def _connected(config: AutopilotConfig, seconds: float) -> AsyncIterator[MavsdkAutopilot]:
    """With the firmware's version and what its arming checks say, where the vehicle tells them."""
    edge = MavsdkAutopilot(config.url, MonotonicClock(), system_id=config.system_id)
    await edge.connect(seconds)
    watch = asyncio.create_task(edge.watch())
    try:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_VERSION_S):
                while not edge.state().firmware or edge.state().can_arm is False:  # noqa: ASYNC110 - it is polled
                    await asyncio.sleep(_LOOK_S)
        yield edge
    finally:
        watch.cancel()
        await edge.aclose()


def _vehicle(state: VehicleState) -> Check:
    if state.autopilot == "px4":
        return Check("vehicle", True, vehicle_name(state))
    return Check("vehicle", False, other_vehicle(state.autopilot), "autopilot.system_id says which one is ours")


def _arming(vehicle: VehicleState) -> Check:
    """Not judged: without GPS they pass only while the service sends poses."""
    if vehicle.can_arm is False:
        why = "; ".join(vehicle.arming_reasons) or "it has not said why"
        return Check("arming checks", True, f"PX4's own fail now: {why}; engage refuses until they pass")
    return Check("arming checks", True, "PX4's own pass" if vehicle.can_arm else "this firmware does not tell of them")


async def _parameters(config: Config, gps: bool, edge: MavsdkAutopilot) -> list[Check]:
    values: dict[str, float | str] = {}
    for requirement in required_parameters(gps):
        try:
            values[requirement.name] = await edge.parameter(requirement.name)
        except AutopilotError as error:
            values[requirement.name] = str(error)
    problems = list(
        parameter_problems(values, gps, Heights(config.mission.takeoff_height_m, config.gate.fence_max_m[2]))
    )
    if not problems:
        return [Check("parameters", True, f"all {len(values)} are as engage wants them")]
    return [Check("parameter", False, problem) for problem in problems]
