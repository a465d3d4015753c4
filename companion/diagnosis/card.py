"""The card on its bus, before anything of its driver is asked."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from companion.config.schema import Config
from companion.radio.checks import Check, System, static_checks

_PCI: Final = Path("sys/bus/pci/devices")
_INTEL: Final = "0x8086"
_CARDS: Final = {
    "netlink": ("an Intel 5300", {"0x4235", "0x4236"}),
    "nl80211": ("an Intel AX200 or AX210", {"0x2723", "0x2725"}),
}
"""By csi.source: what it is called, and its PCI device ids."""


def card_checks(config: Config, root: Path, system: System) -> Iterator[Check]:
    """Without a card nothing of its driver and interface can be looked at; the connector is the kernel's own."""
    if config.csi.source not in _CARDS:
        yield from static_checks(config, system)
        return
    name, ids = _CARDS[config.csi.source]
    found = [device.name for device in sorted((root / _PCI).glob("*")) if _is_one(device, ids)]
    if found:
        yield Check("card", True, f"{name} at {', '.join(found)}")
        yield from _ax_checks(system) if config.csi.source == "nl80211" else ()
        yield from static_checks(config, system)
        return
    listed = ", ".join(f"8086:{one.removeprefix('0x')}" for one in sorted(ids))
    yield Check("card", False, f"there is not {name} (PCI {listed})", "is it in its slot? lspci -nn -d 8086:")
    for check in static_checks(config, system):
        if check.name == "connector" or check.ok:
            yield check
        else:
            yield Check(check.name, None, "not looked at: there is no card")


def _is_one(device: Path, ids: set[str]) -> bool:
    try:
        return (device / "vendor").read_text().strip() == _INTEL and (device / "device").read_text().strip() in ids
    except OSError:
        return False


def _ax_checks(system: System) -> Iterator[Check]:
    """The driver of FeitCSI, and whether it has been told to measure."""
    if not (system.modules / "iwlmvm").is_dir():
        yield Check("driver", False, "the module iwlmvm is not loaded", "modprobe iwlwifi")
        return
    if not (folders := list(system.debug.glob("ieee80211/phy*/iwlwifi/iwlmvm"))):
        yield Check("driver", None, f"{system.debug} cannot be read", "as root, with debugfs mounted")
        return
    switches = [folder / "csi_enabled" for folder in folders if (folder / "csi_enabled").exists()]
    if not switches:
        yield Check(
            "driver", False, "iwlmvm has no switch csi_enabled: it is the stock driver", "install that of FeitCSI"
        )
        return
    yield Check("driver", True, "that of FeitCSI is loaded")
    on = switches[0].read_text().strip() not in ("0", "N", "")
    yield Check("csi_enabled", on, "on" if on else "off", "" if on else "systemctl start companion-radio")
