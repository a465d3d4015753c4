"""The channel of a wireless interface, asked of the kernel by generic netlink (linux/nl80211.h)."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from csi_bridge.generic_netlink import NETLINK_GENERIC, attribute, attributes, decode_message, family_number, request
from csi_bridge.records import CsiError

_GET_INTERFACE: Final = 5
_IFINDEX, _WIPHY_FREQ, _CHANNEL_WIDTH = 3, 38, 159
_WIDTHS_MHZ: Final = (20, 20, 40, 80, 160, 160, 5, 10)
"""By nl80211_chan_width: 20 without and with HT, 40, 80, 80+80, 160, 5, 10."""
_TIMEOUT_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class Tuned:
    """What an interface is set to."""

    primary_mhz: int
    """Centre of the primary 20 MHz."""
    width_mhz: int | None
    """None where the kernel does not say, or a width that has no name here."""


def tuned(interface: str) -> Tuned | None:
    """None where no channel is set. Raises OSError: no such interface, or not wireless."""
    index = socket.if_nametoindex(interface)
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, NETLINK_GENERIC) as opened:
        opened.settimeout(_TIMEOUT_S)
        try:
            family = family_number(opened, "nl80211")
            answer = request(opened, family, _GET_INTERFACE, attribute(_IFINDEX, index.to_bytes(4, "little")))
            return of_attributes(dict(attributes(decode_message(answer)[2])))
        except CsiError:
            raise OSError(errno.EPROTO, os.strerror(errno.EPROTO)) from None
        except OSError as error:
            if error.errno in (errno.ENODEV, errno.ENOENT):
                raise OSError(error.errno, "not a wireless interface") from None
            raise


def of_attributes(found: Mapping[int, memoryview]) -> Tuned | None:
    """From the attributes of the kernel's answer."""
    if _WIPHY_FREQ not in found:
        return None
    number = int.from_bytes(found[_CHANNEL_WIDTH][:4], "little") if _CHANNEL_WIDTH in found else len(_WIDTHS_MHZ)
    width_mhz = _WIDTHS_MHZ[number] if number < len(_WIDTHS_MHZ) else None
    return Tuned(int.from_bytes(found[_WIPHY_FREQ][:4], "little"), width_mhz)
