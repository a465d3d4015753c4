"""A `VirtualVehicle` whose link opens and closes, and whose time passes for whoever sleeps."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

import pytest

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.autopilot.port import AutopilotError
from companion.core.clock import NS_PER_S
from tests.manual_clock import ManualClock
from tests.unit.companion.autopilot.virtual_vehicle import VirtualVehicle


class VirtualLine(VirtualVehicle):
    """With the part of a link that opens and closes; whoever sleeps lets the vehicle's time pass."""

    clock: RunningClock

    def __init__(self, **options: Any) -> None:
        super().__init__(clock=RunningClock(), **options)
        self.clock.line = self
        self.watches = False
        self.opened: list[tuple[float, float]] = []
        """When, and how long to wait for it [s]."""
        self.closed = 0
        self.refuses: list[Exception | None] = []
        """Why the next ones cannot be opened."""
        self.heard: set[str] = set()
        self.told: list[tuple[float, str, dict[str, Any]]] = []
        self.is_cut = False
        self.every: Callable[[], object] = lambda: None
        """Called each time that it runs."""
        self.edge = MavsdkAutopilot(self.url, self.clock)  # of a vehicle not yet known
        self.edge._link = self.edge.ground._link = self  # type: ignore[assignment]

    @property
    def now_s(self) -> float:
        return self.clock.now_ns() / NS_PER_S

    async def open(self, timeout_s: float) -> None:
        self.opened.append((self.now_s, timeout_s))
        refusal = self.refuses.pop(0) if self.refuses else None
        if refusal is not None:
            raise refusal

    async def aclose(self) -> None:
        self.closed += 1

    def others(self) -> set[str]:
        return self.heard

    def send(self, name: str, /, **fields: Any) -> None:
        if self.is_cut:
            raise AutopilotError("cut")
        self.told.append((self.now_s, name, fields))
        if name not in ("ONBOARD_COMPUTER_STATUS", "NAMED_VALUE_FLOAT"):  # the mock does not look at them
            super().send(name, **fields)

    def run(self, seconds: float) -> None:
        super().run(seconds)
        self.every()

    def times_s(self, name: str) -> list[float]:
        return [at_s for at_s, told, _ in self.told if told == name]

    def asked(self, command: int, first: int | None = None) -> list[float]:
        """When a command was sent, or the one with that first parameter [s]."""
        return [
            at_s
            for at_s, name, fields in self.told
            if name == "COMMAND_LONG" and fields["command"] == command and first in (None, fields["param1"])
        ]

    def tell(self, name: str, /, **fields: Any) -> None:
        """What the vehicle says, past the mock."""
        self.edge._telemetry.take(name, 1, json.dumps(fields))

    def tell_mode(self, mode: tuple[int, int], armed: bool = True) -> None:
        """By a heartbeat: PX4's main and sub mode."""
        main, sub = mode
        self.tell(
            "HEARTBEAT",
            custom_mode=main << 16 | sub << 24,
            autopilot=12,
            type=2,
            system_status=4,
            base_mode=128 * armed,
        )

    def answer(self, command: int, result: int = 0, times: int = 1) -> None:
        for _ in range(times):
            self.tell("COMMAND_ACK", command=command, result=result)

    def pass_by(self, seconds: float) -> None:
        """Time without the vehicle."""
        for _ in range(round(seconds * 10)):
            self.clock.advance(0.1)
            self.edge._ask_again()


class RunningClock(ManualClock):
    line: VirtualLine

    def __init__(self) -> None:
        super().__init__(6844 * NS_PER_S)

    async def sleep_until_ns(self, deadline_ns: int) -> None:
        while self.now_ns() < deadline_ns:
            self.line.run(0.01)
        await asyncio.create_task(nothing())  # whoever is cancelled meanwhile ends here


async def nothing() -> None:
    pass


def line_of(monkeypatch: pytest.MonkeyPatch) -> VirtualLine:
    """One that the edge's own waits run."""
    line = VirtualLine()

    async def sleep(seconds: float) -> None:
        line.run(seconds)

    monkeypatch.setattr("companion.autopilot.mavsdk_edge.asyncio.sleep", sleep)
    return line
