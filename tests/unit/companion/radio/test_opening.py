"""Which source of CSI a configuration means."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from companion.config.file import load_config
from companion.errors import CompanionError
from companion.radio.opening import mac_bytes, macs, open_csi
from csi_bridge.unix_socket import UnixSource
from tests.paths import CONFIGS

UAV = load_config(CONFIGS / "demo-uav.yaml")


def test_a_socket_stands_in_for_the_card(tmp_path: Path) -> None:
    source = open_csi(replace(UAV, csi=replace(UAV.csi, source="unix", socket=str(tmp_path / "csi"))))
    assert isinstance(source, UnixSource)
    source.close()


def test_what_cannot_be_opened_is_named_by_its_key(tmp_path: Path) -> None:
    nowhere = replace(UAV.csi, source="unix", socket=str(tmp_path / "nowhere" / "csi"))
    with pytest.raises(CompanionError, match=r"^csi\.source unix: "):
        open_csi(replace(UAV, csi=nowhere))
    with pytest.raises(CompanionError, match=r"^csi\.source nl80211: .*"):
        open_csi(replace(UAV, csi=replace(UAV.csi, source="nl80211", interface="nosuch0", require_kernel_sender=True)))


def test_peers_are_known_by_their_cards() -> None:
    (peer,) = UAV.peers
    assert macs(UAV) == {mac_bytes(peer.mac): peer.id}
    assert mac_bytes("00:21:6A:3F:17:5A") == b"\x00\x21\x6a\x3f\x17\x5a"
    with pytest.raises(ValueError, match="hexadecimal"):
        mac_bytes("00:21:6A:3F:17:XY")
