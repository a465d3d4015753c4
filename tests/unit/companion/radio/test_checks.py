"""What must be true of the card: each check says OK, or what to do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from companion.config.file import load_config
from companion.config.schema import Config, CsiConfig
from companion.errors import CompanionError
from companion.radio.checks import Check, System, channel_words, failed, static_checks
from tests.paths import CONFIGS

UAV = load_config(CONFIGS / "demo-uav.yaml")


def _config(**csi: object) -> Config:
    return replace(UAV, csi=replace(UAV.csi, **csi))  # type: ignore[arg-type]


def _named(config: Config, system: System) -> dict[str, Check]:
    return {check.name: check for check in static_checks(config, system)}


@pytest.fixture
def system(tmp_path: Path) -> System:
    """A machine without a card."""
    for name in ("module", "net", "debug", "ieee80211"):
        (tmp_path / name).mkdir()
    return System(tmp_path / "module", tmp_path / "net", tmp_path / "debug", tmp_path / "ieee80211")


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_each_step_towards_a_driver_that_reports_is_told(system: System) -> None:
    config = _config(source="netlink", interface=None)
    assert _named(config, system)["driver"].remedy == "modprobe iwlwifi connector_log=0x1"
    (system.modules / "iwldvm").mkdir()
    stock = _named(config, system)["driver"]
    assert not stock.ok
    assert "stock driver" in stock.found
    switch = system.modules / "iwlwifi" / "parameters" / "connector_log"
    _write(switch, "0x0\n")
    checks = _named(config, system)
    assert checks["driver"].ok
    assert (checks["connector_log"].ok, checks["connector_log"].remedy) == (False, f"echo 0x1 > {switch}")
    _write(switch, "0x5\n")
    assert _named(config, system)["connector_log"].ok


def test_the_drivers_own_switch_counts_before_the_modules(system: System) -> None:
    _write(system.modules / "iwlwifi" / "parameters" / "connector_log", "0x0\n")
    _write(system.debug / "ieee80211/phy0/iwlwifi/iwldvm/debug/connector_log", "0x1\n")
    assert _named(_config(source="netlink"), system)["connector_log"].ok


def test_records_of_a_process_need_no_driver(system: System) -> None:
    checks = _named(_config(source="unix", interface=None), system)
    assert {name: check.ok for name, check in checks.items()} == {"driver": None, "interface": None}


def test_an_interface_that_is_missing_managed_or_down_is_told_with_its_remedy(system: System) -> None:
    config = _config(source="unix", interface="mon0")
    assert _named(config, system)["interface"].remedy == "iw phy phy0 interface add mon0 type monitor"
    _write(system.networks / "mon0" / "type", "1\n")
    _write(system.networks / "mon0" / "operstate", "down\n")
    checks = _named(config, system)
    assert "iw dev mon0 set type monitor" in checks["interface"].remedy
    assert checks["interface up"].remedy == "ip link set mon0 up"
    _write(system.networks / "mon0" / "type", "803\n")
    _write(system.networks / "mon0" / "operstate", "unknown\n")
    checks = _named(config, system)
    assert checks["interface"].ok
    assert checks["interface up"].ok


@pytest.mark.parametrize(
    ("channel", "width_mhz", "words"),
    [(108, 20, "HT20"), (108, 40, "HT40+"), (112, 40, "HT40-"), (108, 80, "80MHz"), (100, 160, "160MHz")],
)
def test_a_channel_is_said_as_iw_takes_it(channel: int, width_mhz: int, words: str) -> None:
    csi = CsiConfig(channel, source="nl80211", width_mhz=width_mhz)  # type: ignore[arg-type]
    assert channel_words(csi) == (str(channel), words)


def test_only_what_is_wrong_is_a_failure_and_each_is_named_once() -> None:
    failed([Check("a", True, ""), Check("b", None, "")])
    wrong = [Check("a", False, ""), Check("b", True, ""), Check("a", False, ""), Check("c", False, "")]
    with pytest.raises(CompanionError, match=r"^not ready: a, c$"):
        failed(wrong)
