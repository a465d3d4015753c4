"""What stands before an autopilot hands everything on but what it is there for."""

from __future__ import annotations

import inspect
from typing import Any

import pytest

from companion.autopilot.delegating import DelegatingAutopilot
from companion.autopilot.port import Autopilot
from companion.autopilot.silent import SilentAutopilot
from companion.autopilot.snapshot import SnapshotAutopilot

_PORT = sorted(name for name, _ in inspect.getmembers(Autopilot) if not name.startswith("_"))


class _Inner:
    """Answers each call with its name and arguments."""

    problem = "problem"

    def __getattr__(self, name: str) -> Any:
        if not inspect.iscoroutinefunction(getattr(Autopilot, name)):
            return lambda *arguments: (name, *arguments)

        async def answer(*arguments: object) -> object:
            return name, *arguments

        return answer


def _defaults(kind: type, name: str) -> dict[str, object]:
    return {key: one.default for key, one in inspect.signature(getattr(kind, name)).parameters.items()}


@pytest.mark.parametrize("name", _PORT)
async def test_every_method_of_the_port_is_handed_on_with_its_arguments(name: str) -> None:
    assert name in vars(DelegatingAutopilot), "a method of the port that nobody hands on"
    outer = DelegatingAutopilot(_Inner())
    if name == "problem":
        assert outer.problem == "problem"
        return
    method = getattr(outer, name)
    assert _defaults(DelegatingAutopilot, name) == _defaults(Autopilot, name)
    arguments = tuple(inspect.signature(method).parameters)
    answer = method(*arguments)
    answer = await answer if inspect.isawaitable(answer) else answer
    assert answer in ((name, *arguments), None)
    returns = inspect.signature(getattr(Autopilot, name)).return_annotation != "None"
    assert (answer is None) is not returns


def test_each_changes_only_what_it_is_there_for() -> None:
    changed = {kind: set(vars(kind)) & set(_PORT) for kind in (SilentAutopilot, SnapshotAutopilot)}
    commands = {"arm", "takeoff", "request_offboard", "hold", "land", "return_home", "send_setpoint"}
    assert changed == {SilentAutopilot: commands, SnapshotAutopilot: {"state"}}
