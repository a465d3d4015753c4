"""The demo's operator over a service that answers and a world that tells, when nobody arrives."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import socket
import time
from pathlib import Path
from typing import Any

import pytest

from companion.commands.demo import demo
from companion.errors import CompanionError
from companion.sim import truth
from companion.sim.demo import refuse_flown
from companion.sim.stage import Stage
from tests.control_socket import serving
from tests.paths import ROOT
from tests.vehicle_truth import vehicle_truth

_PERIOD_S = 0.05


class Cast:
    """Stands where the processes would: the vehicle hovers, the service flies and finds nothing."""

    def __init__(self, stage: Stage, out: Path) -> None:
        self._stage = stage
        self._out = out
        self._stack = contextlib.AsyncExitStack()
        self._engaged = False

    async def __aenter__(self) -> Cast:
        shutil.copyfile(ROOT / "tests" / "golden" / "approach.mcap", self._out / "log.mcap")
        await self._stack.enter_async_context(serving(self._stage.control_socket, self._answer))
        told = asyncio.create_task(self._tell())
        self._stack.callback(told.cancel)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()

    def ended(self) -> str:
        return ""

    async def _answer(self, command: str, target: str | None = None) -> dict[str, Any]:
        self._engaged |= command == "engage"
        state = "acquiring" if self._engaged else "idle"
        return {"ok": True, "state": state, "reason": "", "not_ready": [], "bearing": None, "health": {}}

    async def _tell(self) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as out:
            while True:
                out.sendto(truth.encode(_hovering(time.monotonic_ns())), str(self._stage.truth_socket))
                await asyncio.sleep(_PERIOD_S)


def _hovering(now_ns: int) -> truth.WorldTruth:
    return truth.WorldTruth(
        t_mono_ns=now_ns,
        vehicle=vehicle_truth(now_ns, (0.0, 0.0, 1.5)),
        uav_antenna_enu_m=(0.0, 0.0, 1.5),
        beacon_antenna_enu_m=(15.0, 0.0, 0.2),
        beacon_v_enu_m_s=(0.0, 0.0, 0.0),
        distance_m=15.06,
        exchanges=0,
    )


def test_a_time_limit_ends_it_without_success(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("companion.sim.demo.Cast", Cast)
    monkeypatch.setattr("companion.commands.demo.is_compiled", lambda: True)
    began_s = time.monotonic()
    with pytest.raises(CompanionError, match="seed 7: no rendezvous within 1 s") as refused:
        demo.main(["--seed", "7", "--max-time", "1", "--out", str(tmp_path)], standalone_mode=False)
    assert refused.value.exit_code == 1
    assert time.monotonic() - began_s > 1.0
    said = capsys.readouterr().out
    assert "NOT reached: no rendezvous within 1 s" in said
    assert (tmp_path / "flight.png").exists() and (tmp_path / "log.mcap").exists()


@pytest.mark.parametrize("name", ["log.mcap", "log.3.mcap", "beacon.mcap", "truth.mcap"])
def test_a_log_of_no_demo_is_not_deleted(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("flown")
    with pytest.raises(CompanionError, match=f"{name}: is there already, and of no demo"):
        demo.main(["--out", str(tmp_path), "--json", str(tmp_path / "r.json")], standalone_mode=False)
    assert (tmp_path / name).read_text() == "flown"
    (tmp_path / "world.txt").touch()
    refuse_flown(tmp_path)
