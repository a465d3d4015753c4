"""The silent autopilot: every command of the port is barred."""

from __future__ import annotations

import inspect

import pytest

from companion.autopilot.port import Autopilot, AutopilotError
from companion.autopilot.silent import SilentAutopilot
from companion.core.messages import Setpoint


class _Autopilot:
    """Notes every call."""

    problem = ""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def __getattr__(self, name: str) -> object:
        self.calls.append(name)
        return lambda *_: None


_COMMANDS = ("arm", "takeoff", "request_offboard", "hold", "land", "return_home")


@pytest.mark.parametrize("name", _COMMANDS)
async def test_an_observing_service_cannot_command(name: str) -> None:
    inner = _Autopilot()
    silent = SilentAutopilot(inner)  # type: ignore[arg-type]
    arguments = (1.5,) if name == "takeoff" else ()
    with pytest.raises(AutopilotError, match="was not sent: the service observes"):
        await getattr(silent, name)(*arguments)
    with pytest.raises(AutopilotError, match="a set point was not sent"):
        silent.send_setpoint(Setpoint(0, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0))
    assert inner.calls == []


def test_every_command_of_the_port_is_barred_or_harmless() -> None:
    """A method that is added to the port must be thought of here."""
    harmless = {"connect", "run", "problem", "aclose", "state", "take_events", "parameter", "send_odometry"}
    harmless |= {"set_origin"}
    port = {name for name, _ in inspect.getmembers(Autopilot) if not name.startswith("_")}
    assert port == harmless | set(_COMMANDS) | {"send_setpoint"}
