"""Keys and the robots' network, on the loopback."""

from __future__ import annotations

import asyncio
import dataclasses
import time
from pathlib import Path

import pytest

from companion.config.file import load_config
from companion.config.schema import Config
from companion.diagnosis.network import key_checks, network_checks
from companion.neighbours.keys import read_key, write_key
from companion.neighbours.link import Link
from companion.neighbours.sender import NeighbourSender
from companion.neighbours.wire import Role
from companion.sim.stage import free_udp_port
from tests.paths import CONFIGS


@pytest.fixture
def config(tmp_path: Path) -> Config:
    """The demo's flying robot with keys, on a port of its own."""
    config = load_config(CONFIGS / "demo-uav.yaml")
    write_key(tmp_path / "uav.key")
    write_key(tmp_path / "beacon.key")
    neighbours = dataclasses.replace(config.neighbours, port=free_udp_port("127.255.255.255"))
    return dataclasses.replace(config, runtime_dir=str(tmp_path), neighbours=neighbours)


async def _looked(config: Config, key: bytes | None) -> dict[str, bool | None]:
    """While the beacon sends with `key`."""
    link = Link(config)
    sender = NeighbourSender(
        role=Role.BEACON, own_id=2, key=key or bytes(32), pose_rate_hz=50.0, boot_id=1 << 32, budget_bytes_s=5000.0
    )
    looking = asyncio.create_task(network_checks(config, 0.5, None))
    while not looking.done():
        if key is not None:
            sender.add_pose(time.monotonic_ns(), (0.0, 0.0, 0.0), 3)
            for datagram in sender.datagrams(time.monotonic_ns()):
                link.send(datagram)
        await asyncio.sleep(0.05)
    link.close()
    return {check.name: check.ok for check in await looking}


async def test_who_is_heard_and_whose_key_is_another_one(config: Config, tmp_path: Path) -> None:
    key = read_key(tmp_path / "beacon.key")
    assert await _looked(config, None) == {"robots' network": True, "robot beacon": None}
    assert await _looked(config, key) == {"robots' network": True, "robot beacon": True}
    assert await _looked(config, bytes(32)) == {"robots' network": True, "robot beacon": False}


async def test_a_network_that_this_host_does_not_have_is_told(config: Config) -> None:
    neighbours = dataclasses.replace(config.neighbours, broadcast="203.0.113.255")
    (check,) = await network_checks(dataclasses.replace(config, neighbours=neighbours), 0.5, None)
    assert check.ok is False and "expected the broadcast address of a network of this host" in check.found


async def test_a_running_service_is_asked(config: Config) -> None:
    health = {"network_problem": "", "neighbours": {"beacon": {"state": "tracked"}, "other": {"state": "lost"}}}
    checks = await network_checks(config, 0.5, {"ok": True, "health": health})
    assert [check.ok for check in checks] == [True, True, None]


def test_one_key_for_two_robots_is_told(config: Config, tmp_path: Path) -> None:
    assert [check.ok for check in key_checks(config)] == [True, True]
    (tmp_path / "beacon.key").write_bytes((tmp_path / "uav.key").read_bytes())
    own, beacon = key_checks(config)
    assert own.ok and beacon.ok is False and "the same bytes as own key" in beacon.found
    (tmp_path / "beacon.key").unlink()
    assert [check.ok for check in key_checks(config)] == [True, False]
