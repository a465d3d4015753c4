"""`companion status` as a command: a table, JSON, colours only where somebody sees them."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

from tests.control_socket import serving
from tests.unit.companion.commands.test_status_lines import status

_RADIO = {"samples": 9, "lost": 0, "malformed": 0, "unknown_sender": 0, "no_sender": 0, "wide": 0}


async def _answer(command: str, target: str | None = None) -> dict[str, object]:
    told = status()
    told["health"] |= {"radio": _RADIO, "link": {"unknown_sender": 0, "malformed": 0, "version": 0}}
    return told


async def _run(path: Path, *options: str, **environment: str) -> subprocess.CompletedProcess[str]:
    async with serving(path, _answer):
        return await asyncio.to_thread(
            subprocess.run,
            [sys.executable, "-m", "companion", "status", "--socket", str(path), *options],
            capture_output=True, text=True, check=False, env=os.environ | environment,
        )  # fmt: skip


async def test_a_person_reads_a_table_without_colours_in_a_pipe(tmp_path: Path) -> None:
    done = await _run(tmp_path / "control.sock")
    assert done.returncode == 0, done.stderr
    assert "approaching" in done.stdout and "compass 148°" in done.stdout and "✓" in done.stdout
    assert "\x1b[" not in done.stdout


async def test_no_color_is_respected_on_a_terminal(tmp_path: Path) -> None:
    coloured = await _run(tmp_path / "control.sock", FORCE_COLOR="1", TERM="xterm")
    assert "\x1b[32m" in coloured.stdout or "\x1b[92m" in coloured.stdout
    plain = await _run(tmp_path / "control.sock", FORCE_COLOR="1", TERM="xterm", NO_COLOR="1")
    assert "\x1b[32m" not in plain.stdout


async def test_a_program_gets_everything(tmp_path: Path) -> None:
    done = await _run(tmp_path / "control.sock", "--json")
    told = json.loads(done.stdout)
    assert told["target"]["range_std_m"] == 11.9 and told["about"]["name"] == "uav"


async def test_watching_goes_on_until_it_is_interrupted_and_waits_for_a_service_that_is_gone(tmp_path: Path) -> None:
    path = tmp_path / "control.sock"
    async with serving(path, _answer):
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "companion", "status", "--socket", str(path), "--json", "--watch",
            stdout=asyncio.subprocess.PIPE,
        )  # fmt: skip
        assert process.stdout is not None
        told = [json.loads(await process.stdout.readline()) for _ in range(2)]
        assert [one["state"] for one in told] == ["approaching"] * 2
    async with asyncio.timeout(60):
        while json.loads(await process.stdout.readline())["ok"]:
            pass
        process.send_signal(signal.SIGINT)
        assert await process.wait() == 0
