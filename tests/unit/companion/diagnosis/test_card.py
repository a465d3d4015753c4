"""The card on its bus: what needs it is not blamed where it is not there."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Literal

import pytest

from companion.config.file import load_config
from companion.diagnosis.card import card_checks
from companion.radio.checks import Check, System
from tests.paths import CONFIGS


def _checks(root: Path, source: Literal["netlink", "nl80211"]) -> dict[str, Check]:
    config = load_config(CONFIGS / "uav.yaml")
    config = dataclasses.replace(config, csi=dataclasses.replace(config.csi, source=source))
    system = System(root / "modules", root / "net", root / "debug", root / "phys")
    return {check.name: check for check in card_checks(config, root, system)}


def _plug(root: Path, device: str) -> None:
    folder = root / "sys/bus/pci/devices/0000:01:00.0"
    folder.mkdir(parents=True)
    (folder / "vendor").write_text("0x8086\n")
    (folder / "device").write_text(f"{device}\n")


def test_without_a_card_its_driver_is_not_looked_at(tmp_path: Path) -> None:
    found = _checks(tmp_path, "netlink")
    assert found["card"].ok is False and "PCI 8086:4235, 8086:4236" in found["card"].found
    assert found["driver"].ok is None and found["interface"].ok is None
    assert "not looked at" in found["driver"].found


@pytest.mark.parametrize(("device", "ok"), [("0x4236", True), ("0x2725", False)])
def test_the_card_is_known_by_its_ids(tmp_path: Path, device: str, ok: bool) -> None:
    _plug(tmp_path, device)
    found = _checks(tmp_path, "netlink")
    assert found["card"].ok is ok
    assert found["driver"].ok is (False if ok else None)


def test_an_ax_card_needs_its_driver_and_to_be_told(tmp_path: Path) -> None:
    _plug(tmp_path, "0x2725")
    assert _checks(tmp_path, "nl80211")["driver"].remedy == "modprobe iwlwifi"
    (tmp_path / "modules" / "iwlmvm").mkdir(parents=True)
    assert _checks(tmp_path, "nl80211")["driver"].ok is None
    card = tmp_path / "debug/ieee80211/phy0/iwlwifi/iwlmvm"
    card.mkdir(parents=True)
    assert "stock driver" in _checks(tmp_path, "nl80211")["driver"].found
    for text, ok in (("0\n", False), ("1\n", True)):
        (card / "csi_enabled").write_text(text)
        found = _checks(tmp_path, "nl80211")
        assert found["driver"].ok and found["csi_enabled"].ok is ok
