"""The units: systemd takes them, none is exposed more than it must be, and what they promise fits the program."""

from __future__ import annotations

import re
import shutil
import subprocess
from configparser import RawConfigParser
from pathlib import Path

import pytest

from companion.config.file import load_config
from companion.config.unit_settings import drop_in
from companion.host.ending import END_LIMIT_S, START_LIMIT_S
from companion.host.priority import LOOP_PRIORITY
from tests.paths import CONFIGS, ROOT

_FOLDER = ROOT / "systemd"
_UNITS = sorted(_FOLDER.glob("*.service"))
_SERVICES = [_FOLDER / "companion.service", _FOLDER / "companion-beacon.service"]
_MOST_EXPOSED = "30"
"""Of systemd-analyze's 0 to 100, which it prints as 3.0."""
_PINGS = "ping:\n  enabled: true\n"

needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze here")
each = pytest.mark.parametrize("unit", _UNITS, ids=lambda unit: unit.name)


def _read(unit: Path) -> dict[str, list[str]]:
    """Every value of each key, comments off, whichever section it stands in."""
    found: dict[str, list[str]] = {}
    for line in unit.read_text().splitlines():
        key, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            found.setdefault(key, []).append(value)
    return found


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """The units with programs that are there in place of those of /opt/companion."""
    for unit in _UNITS:
        for program in re.findall(r"/opt/companion/\S+/bin/\w+", unit.read_text()):
            stub = tmp_path / program.lstrip("/")
            stub.parent.mkdir(parents=True, exist_ok=True)
            stub.write_text("#!/bin/sh\n")
            stub.chmod(0o755)
        (tmp_path / unit.name).write_text(unit.read_text().replace("/opt/companion", f"{tmp_path}/opt/companion"))
    return tmp_path


def _analyze(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["systemd-analyze", "--no-pager", *words], capture_output=True, text=True, check=False)


@needs_systemd
def test_systemd_takes_every_unit(installed: Path) -> None:
    done = _analyze("verify", *(str(installed / unit.name) for unit in _UNITS))
    told = [line for line in done.stderr.splitlines() if "companion" in line]
    assert (done.returncode, told) == (0, [])


@needs_systemd
@each
@pytest.mark.parametrize("pings", [False, True], ids=["", "pings"])
def test_a_unit_is_exposed_below_3(installed: Path, unit: Path, pings: bool) -> None:
    if pings:
        folder = installed / f"{unit.name}.d"
        folder.mkdir()
        (folder / "10-configuration.conf").write_text(_drop_in_of_a_pinging_robot(installed))
    done = _analyze("security", "--offline=true", f"--threshold={_MOST_EXPOSED}", str(installed / unit.name))
    assert done.returncode == 0, done.stdout
    assert "Overall exposure level" in done.stdout


def _drop_in_of_a_pinging_robot(folder: Path) -> str:
    (folder / "pings.yaml").write_text((CONFIGS / "uav.yaml").read_text() + _PINGS)
    return drop_in(load_config(folder / "pings.yaml"))


@each
def test_nothing_gives_up_and_a_wrong_configuration_does_not_loop(unit: Path) -> None:
    keys = _read(unit)
    assert keys["StartLimitIntervalSec"] == ["0"]
    assert keys["Restart"] in (["always"], ["on-failure"]) and "RestartSec" in keys
    assert keys["RestartPreventExitStatus"] == ["2"]
    assert "MemoryMax" in keys


@pytest.mark.parametrize("unit", _SERVICES, ids=lambda unit: unit.name)
def test_a_service_is_ready_when_it_says_so_and_has_time_to_end(unit: Path) -> None:
    keys = _read(unit)
    assert keys["Type"] == ["notify"]
    assert float(keys["TimeoutStopSec"][0]) > END_LIMIT_S
    assert float(keys["TimeoutStartSec"][0]) > START_LIMIT_S
    assert keys["KillMode"] == ["mixed"], "what carries the hand-over to Hold must not go before the service"
    assert keys["User"] == keys["Group"] == ["companion"]
    assert keys["ConfigurationDirectory"] == keys["StateDirectory"] == keys["LogsDirectory"] == ["companion"]
    assert {"CPUWeight", "OOMScoreAdjust", "WatchdogSec"} <= keys.keys()


def test_only_the_flying_one_has_a_serial_line_and_real_time() -> None:
    uav, beacon = map(_read, _SERVICES)
    assert uav["SupplementaryGroups"] == ["dialout"] and uav["LimitRTPRIO"] == [str(LOOP_PRIORITY)]
    assert "SupplementaryGroups" not in beacon and "LimitRTPRIO" not in beacon and beacon["PrivateDevices"] == ["yes"]


@each
def test_raw_frames_are_in_no_unit_itself(unit: Path) -> None:
    assert "CAP_NET_RAW" not in unit.read_text() and "AF_PACKET" not in unit.read_text()


def test_the_udev_rules_know_both_ids_of_the_camera() -> None:
    rules = (_FOLDER / "udev" / "60-companion-t265.rules").read_text()
    ids = re.findall(r'ATTR\{idVendor\}=="(\w{4})", ATTR\{idProduct\}=="(\w{4})", GROUP="plugdev", MODE="0660"', rules)
    assert ids == [("8087", "0b37"), ("03e7", "2150")]


def test_units_are_files_that_systemd_reads() -> None:
    for unit in _UNITS:
        parser = RawConfigParser(strict=False)
        parser.read_string(unit.read_text())
        assert set(parser.sections()) == {"Unit", "Service", "Install"}
