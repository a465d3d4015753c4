"""Which source of CSI a configuration means, and whose frames are whose."""

from __future__ import annotations

from companion.config.schema import Config
from companion.errors import CompanionError
from csi_bridge.feitcsi.netlink import VendorEventSource
from csi_bridge.netlink import NetlinkError, NetlinkSource
from csi_bridge.source import CsiSource
from csi_bridge.unix_socket import UnixSocketError, UnixSource


def open_csi(config: Config) -> CsiSource:
    """The card, or a socket with the same bytes. Raises CompanionError where it cannot be opened."""
    csi = config.csi
    try:
        if csi.source == "unix":
            return UnixSource(config.path(csi.socket), csi.receive_buffer_bytes)
        if csi.source == "nl80211":
            return VendorEventSource(
                csi.interface, csi.require_kernel_sender, csi.receive_buffer_bytes, csi.connector_idx
            )
        return NetlinkSource(csi.connector_idx, csi.require_kernel_sender, csi.receive_buffer_bytes)
    except (NetlinkError, UnixSocketError) as error:
        raise CompanionError(f"csi.source {csi.source}: {error.strerror}") from None


def macs(config: Config) -> dict[bytes, int]:
    """Id of each peer by the six bytes of its MAC."""
    return {mac_bytes(peer.mac): peer.id for peer in config.peers}


def mac_bytes(mac: str) -> bytes:
    """Of an address with colons. Raises ValueError for anything else."""
    return bytes.fromhex(mac.replace(":", ""))
