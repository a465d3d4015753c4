"""The demo's operator: waits for what is missing, asks again after a failed preflight, and only then."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from companion.errors import CompanionError
from companion.sim.operator import engage
from tests.control_socket import serving


class Service:
    """Answers as a service does: `outcomes` are the states and reasons that follow each engagement in turn."""

    def __init__(self, outcomes: list[tuple[str, str]], missing: list[str] | None = None) -> None:
        self._outcomes = outcomes
        self._now = ("idle", "")
        self._missing = missing or []
        self.engagements = 0

    async def answer(self, command: str, target: str | None = None) -> dict[str, Any]:
        if command == "engage":
            self._now = self._outcomes[self.engagements]
            self.engagements += 1
            return {"ok": True}
        if command != "status":
            return {"ok": True}
        state, reason = self._now
        missing, self._missing = self._missing[:1], self._missing[1:]
        return {"ok": True, "state": state, "reason": reason, "not_ready": missing}


async def test_a_failed_preflight_is_tried_again(tmp_path: Path) -> None:
    service = Service([("idle", "preflight_failed: the clock is uncertain"), ("taking_off", "preflight_passed")], ["x"])
    async with serving(tmp_path / "control.sock", service.answer):
        await engage(tmp_path / "control.sock", 10.0)
    assert service.engagements == 2


async def test_who_was_latched_at_once_is_not_engaged_again(tmp_path: Path) -> None:
    service = Service([("latched", "mode_lost")])
    async with serving(tmp_path / "control.sock", service.answer):
        await engage(tmp_path / "control.sock", 10.0)
    assert service.engagements == 1


async def test_what_is_missing_is_named(tmp_path: Path) -> None:
    service = Service([], ["the battery is low"] * 1000)
    async with serving(tmp_path / "control.sock", service.answer):
        with pytest.raises(CompanionError, match=r"not ready after 0\.3 s: the battery is low"):
            await engage(tmp_path / "control.sock", 0.3)
    with pytest.raises(CompanionError, match="nothing has answered yet"):
        await engage(tmp_path / "control.sock", 0.1)
