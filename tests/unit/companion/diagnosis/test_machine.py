"""What doctor says of the machine, on folders like the kernel's."""

from __future__ import annotations

import dataclasses
import importlib.metadata
from pathlib import Path

import pytest

from companion.config.file import load_config
from companion.config.schema import Config
from companion.diagnosis.machine import machine_checks
from companion.radio.checks import Check
from tests.paths import CONFIGS


@pytest.fixture
def config(tmp_path: Path) -> Config:
    config = load_config(CONFIGS / "uav.yaml")
    recorder = dataclasses.replace(config.recorder, path=str(tmp_path / "log" / "log.mcap"))
    return dataclasses.replace(config, recorder=recorder, state_dir=str(tmp_path))


def _checks(config: Config, root: Path) -> dict[str, Check]:
    return {check.name: check for check in machine_checks(config, root)}


def test_this_machine_has_what_the_tests_run_on(config: Config) -> None:
    found = _checks(config, Path("/"))
    assert found["interpreter"].ok and found["packages"].ok
    assert "as they were tested" in found["packages"].found


def test_a_package_of_another_version_is_named(config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.metadata.version
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "1.0" if name == "click" else real(name))
    packages = _checks(config, Path("/"))["packages"]
    assert packages.ok and "click 1.0 in place of" in packages.found
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "4.0" if name == "mavsdk" else real(name))
    packages = _checks(config, Path("/"))["packages"]
    assert packages.ok is False and "mavsdk 4.0 in place of 4.1.0" in packages.found


def test_a_package_that_is_not_there_is_told(config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.metadata.version

    def version(name: str) -> str:
        if name == "numba":
            raise importlib.metadata.PackageNotFoundError(name)
        return real(name)

    monkeypatch.setattr(importlib.metadata, "version", version)
    packages = _checks(config, Path("/"))["packages"]
    assert packages.ok is False and packages.found == "missing or wrong: numba"


def test_a_slow_clock_source_is_told(config: Config, tmp_path: Path) -> None:
    assert _checks(config, tmp_path)["clock source"].ok is None
    folder = tmp_path / "sys/devices/system/clocksource/clocksource0"
    folder.mkdir(parents=True)
    for source, ok in (("tsc", True), ("hpet", False)):
        (folder / "current_clocksource").write_text(f"{source}\n")
        assert _checks(config, tmp_path)["clock source"].ok is ok


def test_a_compiled_kernel_is_found_in_the_services_cache(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    assert _checks(config, tmp_path)["compiled kernel"].ok is None
    folder = tmp_path / "var/cache/companion/wsr_1234"
    folder.mkdir(parents=True)
    (folder / "kernel._product-324.py311.nbi").touch()
    assert _checks(config, tmp_path)["compiled kernel"].ok


def test_a_disk_that_is_full_is_told(config: Config, tmp_path: Path) -> None:
    assert _checks(config, tmp_path)["disk of the log"].ok is None
    (tmp_path / "log").mkdir()
    assert _checks(config, tmp_path)["disk of the log"].ok
    recorder = dataclasses.replace(config.recorder, min_free_mib=1e12)
    disk = _checks(dataclasses.replace(config, recorder=recorder), tmp_path)["disk of the log"]
    assert disk.ok is False and "remove old logs" in disk.remedy
