"""The robots' network: interface, broadcast address, keys, and whom it hears."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import Any, Final

from companion.config.schema import Config
from companion.core.clock import MonotonicClock
from companion.diagnosis.installation import key_check
from companion.errors import CompanionError, ConfigError
from companion.neighbours.keys import read_key
from companion.neighbours.link import Link
from companion.neighbours.receiver import NeighbourReceiver
from companion.radio.checks import Check
from csi_bridge.regular_file import read_regular

_LOOK_S: Final = 0.1


def key_checks(config: Config) -> Iterator[Check]:
    """Ours and each robot's; two that are one would let a robot pass for another."""
    files = {"own key": config.path(config.neighbours.key_file)}
    files |= {f"key of {peer.name}": config.path(peer.key_file) for peer in config.peers}
    known: dict[bytes, str] = {}
    for name, path in files.items():
        check = key_check(name, path)
        same = known.setdefault(read_regular(path), name) if check.ok else name
        if same != name:
            check = Check(
                name, False, f"{path}: the same bytes as {same}", "companion keygen makes another: each has its own"
            )
        yield check


async def network_checks(config: Config, seconds: float, status: dict[str, Any] | None) -> list[Check]:
    """`status` is what a running service says of itself; without one, it is listened for so long."""
    if status is not None:
        return list(_of_service(status))
    try:
        link = Link(config)
    except CompanionError as error:
        return [Check("robots' network", False, str(error), "ip -br address lists interfaces and addresses")]
    try:
        receiver = receiver_of(config)
        for _ in range(round(seconds / _LOOK_S)):
            for data in link.drain():
                receiver.take(data)
            await asyncio.sleep(_LOOK_S)
        link.watch(MonotonicClock().now_ns())
    except ConfigError as error:
        return [Check("robots' network", None, f"not listened to: {str(error).splitlines()[0]}")]
    finally:
        link.close()
    neighbours = config.neighbours
    open_at = f"{neighbours.broadcast}, port {neighbours.port}"
    checks = [
        Check("robots' network", not link.problem, link.problem or open_at, "ip -br link" if link.problem else "")
    ]
    return checks + [_heard(peer, receiver, seconds) for peer in receiver.neighbours]


def receiver_of(config: Config) -> NeighbourReceiver:
    """For every peer, with its key. Raises ConfigError."""
    keys = {peer.id: [read_key(config.path(peer.key_file))] for peer in config.peers}
    return NeighbourReceiver(config.id, {peer.id: peer.name for peer in config.peers}, keys, MonotonicClock())


def _heard(peer: int, receiver: NeighbourReceiver, seconds: float) -> Check:
    neighbour = receiver.neighbours[peer]
    if neighbour.refused.bad_key:
        return Check(
            f"robot {neighbour.name}", False, f"{neighbour.refused.bad_key} datagrams signed with another key",
            "copy its own key here anew",
        )  # fmt: skip
    count = neighbour.accepted
    if not count:
        return Check(f"robot {neighbour.name}", None, f"silent for {seconds:g} s", "is its service running?")
    return Check(f"robot {neighbour.name}", True, f"{count / seconds:.0f} datagrams a second, signed")


def _of_service(status: dict[str, Any]) -> Iterator[Check]:
    health = status.get("health", {})
    problem = health.get("network_problem", "")
    yield Check(
        "robots' network", not problem, problem or "the running service has it", "ip -br link" if problem else ""
    )
    for name, neighbour in health.get("neighbours", {}).items():
        heard = neighbour.get("state") not in (None, "unheard", "lost")
        yield Check(f"robot {name}", True if heard else None, f"the running service says: {neighbour.get('state')}")
