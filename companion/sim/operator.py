"""The person who engages: waits until nothing is missing, and asks again where something was amiss at that very moment.

On a loaded machine what was ready a moment ago may not be at the tick that looks again: the service then stays idle.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Final

from companion.errors import CompanionError
from companion.host.control_socket import ask

_AT_REST: Final = ("idle", "latched")
_ANSWER_S: Final = 2.0
"""A granted wish takes effect at the next tick."""

Look = Callable[[], Awaitable[dict[str, Any] | None]]


async def engage(control: Path, timeout_s: float, look: Look | None = None) -> None:
    """Returns once the service flies, or says something else than that its preflight failed. `look` takes its time and
    gives the service's status, None while it does not listen.

    Raises CompanionError with what was missing last when it is not engaged after `timeout_s`.
    """
    loop = asyncio.get_running_loop()
    deadline_s, granted_s = loop.time() + timeout_s, None
    missing = "nothing has answered yet"
    while loop.time() < deadline_s:
        status = await (look() if look is not None else _status(control))
        if status is None:
            continue
        failed = status["reason"].startswith("preflight_failed")
        if granted_s is not None and not failed:
            if status["state"] not in (*_AT_REST, "preflight") or loop.time() - granted_s > _ANSWER_S:
                return
        elif status["not_ready"]:
            missing = "; ".join(status["not_ready"])
        elif status["state"] in _AT_REST:
            answer = await ask(control, "engage", timeout_s=10.0)
            granted_s = loop.time() if answer["ok"] else None
            missing = status["reason"] if answer["ok"] else answer["error"]
    raise CompanionError(f"not ready after {timeout_s:g} s: {missing}")


async def _status(control: Path) -> dict[str, Any] | None:
    await asyncio.sleep(0.1)
    try:
        return await ask(control, "status")
    except CompanionError:
        return None
