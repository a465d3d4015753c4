"""What is said of a signed link, its relay's process, and that without a key there is nothing of it."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from companion.autopilot.port import AutopilotError
from companion.autopilot.silent import SilentAutopilot
from companion.config.file import load_config
from companion.errors import ConfigError
from companion.signing import autopilot
from companion.signing.autopilot import SignedAutopilot, SigningRelay, signing_relay
from companion.signing.told import RelayReport
from tests.paths import CONFIGS
from tests.signed_link import key_file


def relay(tmp_path: Path, url: str = "udpin://127.0.0.1:0") -> SigningRelay:
    key_file(tmp_path / "a.key")
    return SigningRelay(url, tmp_path / "a.key", tmp_path / "state", None)


def told(tmp_path: Path, *reports: RelayReport) -> str:
    ours = relay(tmp_path)
    for one in reports:
        ours._take(one)
    return ours.problem


def test_each_reason_has_its_words_and_a_vehicle_that_is_taken_has_none(tmp_path: Path) -> None:
    assert told(tmp_path) == "the signing relay is not running: it has not told anything yet"
    assert told(tmp_path, RelayReport()) == "", "nothing comes at all: the edge says that there is no heartbeat"
    assert "a.key does not make: the vehicle has another key" in told(tmp_path, RelayReport(wrong=3, unsigned=9))
    assert "a time that was used before" in told(tmp_path, RelayReport(used=3, unsigned=9))
    assert "are not signed: the vehicle has no key" in told(tmp_path, RelayReport(unsigned=9))
    assert told(tmp_path, RelayReport(taken=1, wrong=50, unsigned=9)) == "", "a stranger on the line ends no flight"


def test_a_key_that_cannot_be_read_ends_the_start(tmp_path: Path) -> None:
    (tmp_path / "a.key").write_bytes(b"short")
    (tmp_path / "a.key").chmod(0o600)
    config = load_config(CONFIGS / "demo-uav.yaml")
    assert config.autopilot is not None and signing_relay(config) is None
    named = replace(config, autopilot=replace(config.autopilot, signing_key_file=str(tmp_path / "a.key")))
    with pytest.raises(ConfigError, match="5 bytes of signing key"):
        signing_relay(named)


async def test_a_relay_that_ends_is_started_again_later_than_any_failsafe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert autopilot.WAIT_S >= 2.0
    monkeypatch.setattr(autopilot, "WAIT_S", 0.1)
    ours = relay(tmp_path, "serial:///dev/there-is-none:57600")
    link = SignedAutopilot(SilentAutopilot(None), ours)  # type: ignore[arg-type]
    link._start()
    async with asyncio.timeout(30):
        while "there-is-none" not in ours.problem:  # noqa: ASYNC110 - it is polled
            await asyncio.sleep(0.02)
    assert ours.problem == ("the signing relay is not running: serial /dev/there-is-none: No such file or directory")
    await link._beside.aclose()
    assert ours.pid is None


async def test_who_connects_hears_the_relays_reason(tmp_path: Path) -> None:
    class Deaf:
        async def connect(self, timeout_s: float) -> None:
            await asyncio.sleep(0)
            raise AutopilotError("no heartbeat within 1 s")

        async def aclose(self) -> None: ...

    ours = relay(tmp_path)
    link = SignedAutopilot(Deaf(), ours)  # type: ignore[arg-type]
    ours._take(RelayReport(unsigned=4))
    with pytest.raises(AutopilotError, match="are not signed"):
        await link.connect(1.0)
    await link.aclose()


def test_a_service_without_a_key_never_loads_what_signs() -> None:
    code = "import sys, companion.app; sys.exit('pymavlink' in sys.modules or 'rosbags' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
