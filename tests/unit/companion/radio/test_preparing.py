"""What is done to a card as root: on folders like the kernel's, with an `iw` that writes down what it is asked."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Literal

import pytest

from companion.config.file import load_config
from companion.config.schema import Config
from companion.errors import CompanionError
from companion.radio.checks import System
from companion.radio.preparing import CardStep, steps
from tests.paths import CONFIGS


@pytest.fixture
def system(tmp_path: Path) -> System:
    """An Intel 5300 with the patched driver as phy1, whose wlan0 is managed."""
    debug = tmp_path / "debug" / "ieee80211" / "phy1" / "iwlwifi" / "iwldvm" / "debug"
    debug.mkdir(parents=True)
    for switch in ("connector_log", "monitor_tx_rate"):
        (debug / switch).write_text("0")
    (tmp_path / "phys" / "phy1" / "device" / "net" / "wlan0").mkdir(parents=True)
    (tmp_path / "net").mkdir()
    return System(tmp_path / "modules", tmp_path / "net", tmp_path / "debug", tmp_path / "phys")


def _config(source: Literal["netlink", "nl80211", "unix"] = "netlink", network: str | None = None) -> Config:
    config = load_config(CONFIGS / "uav.yaml")
    csi = dataclasses.replace(config.csi, source=source, interface="mon0")
    return dataclasses.replace(config, csi=csi, neighbours=dataclasses.replace(config.neighbours, interface=network))


def _said(config: Config, system: System) -> list[str]:
    return [str(step).replace(str(system.debug), "DEBUG") for step in steps(config, system)]


def test_a_card_as_it_comes_is_put_into_monitor_mode(system: System) -> None:
    assert _said(_config(), system) == [
        "ip link set wlan0 down",
        "iw phy phy1 interface add mon0 type monitor",
        "ip link set mon0 up",
        "iw dev mon0 set channel 108 HT20",
        "echo 0x1 > DEBUG/ieee80211/phy1/iwlwifi/iwldvm/debug/connector_log",
    ]


def test_what_is_there_already_is_not_made_again(system: System) -> None:
    (system.networks / "mon0").mkdir()
    (system.networks / "mon0" / "type").write_text("1\n")
    assert _said(_config(), system)[1:3] == ["ip link set mon0 down", "iw dev mon0 set type monitor"]
    (system.networks / "mon0" / "type").write_text("803\n")
    assert _said(_config(), system)[1:2] == ["ip link set mon0 up"]


def test_pings_have_the_rate_of_the_configuration(system: System) -> None:
    config = _config()
    config = dataclasses.replace(config, ping=dataclasses.replace(config.ping, enabled=True, mcs=3))
    assert _said(config, system)[-1] == "echo 0x4103 > DEBUG/ieee80211/phy1/iwlwifi/iwldvm/debug/monitor_tx_rate"


def test_an_ax_card_is_told_to_measure(system: System) -> None:
    card = system.debug / "ieee80211" / "phy2" / "iwlwifi" / "iwlmvm"
    card.mkdir(parents=True)
    with pytest.raises(CompanionError, match=r"expected the driver of FeitCSI, this is the stock one"):
        _said(_config("nl80211"), system)
    (card / "csi_enabled").write_text("0")
    assert _said(_config("nl80211"), system)[-1] == "echo 1 > DEBUG/ieee80211/phy2/iwlwifi/iwlmvm/csi_enabled"


@pytest.mark.parametrize(
    ("channel", "width_mhz", "words"),
    [(108, 20, "HT20"), (108, 40, "HT40+"), (112, 40, "HT40-"), (108, 80, "80MHz"), (108, 160, "160MHz")],
)
def test_an_ax_card_is_set_to_its_width(
    system: System, channel: int, width_mhz: Literal[20, 40, 80, 160], words: str
) -> None:
    card = system.debug / "ieee80211" / "phy2" / "iwlwifi" / "iwlmvm"
    card.mkdir(parents=True)
    (card / "csi_enabled").write_text("0")
    config = _config("nl80211")
    csi = dataclasses.replace(config.csi, channel=channel, width_mhz=width_mhz)
    said = _said(dataclasses.replace(config, csi=csi), system)
    assert f"iw dev mon0 set channel {channel} {words}" in said


def test_the_robots_network_is_never_taken_down(system: System) -> None:
    with pytest.raises(CompanionError, match=r"neighbours\.interface wlan0: .* expected one of another card"):
        _said(_config(network="wlan0"), system)


def test_a_card_that_is_not_there_is_told(system: System, tmp_path: Path) -> None:
    with pytest.raises(CompanionError, match="no card with the driver iwlmvm"):
        _said(_config("nl80211"), system)
    assert _said(_config("unix"), dataclasses.replace(system, debug=tmp_path / "none")) == []


def test_a_step_is_taken_and_its_failure_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "iw").write_text('#!/bin/sh\necho "$@" > "$0.asked"; echo "busy  (-16)" >&2; exit 240\n')
    (tmp_path / "iw").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    with pytest.raises(CompanionError, match=r"iw dev mon0 set channel 108 HT20: busy \(-16\)"):
        CardStep(("iw", "dev", "mon0", "set", "channel", "108", "HT20")).take()
    assert (tmp_path / "iw.asked").read_text() == "dev mon0 set channel 108 HT20\n"
    CardStep((str(tmp_path / "switch"),), "0x1").take()
    assert (tmp_path / "switch").read_text() == "0x1"
    with pytest.raises(CompanionError, match="No such file or directory"):
        CardStep((str(tmp_path / "none" / "switch"),), "1").take()
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(CompanionError, match="ip: not installed; apt install iw iproute2"):
        CardStep(("ip", "link")).take()
