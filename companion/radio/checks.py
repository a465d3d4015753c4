"""What must be true of the card before anything can be measured: each check says OK, or what to do."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from companion.config.schema import Config, CsiConfig
from companion.core.clock import MonotonicClock
from companion.errors import CompanionError
from companion.radio.card import ChannelSample, Radio
from companion.radio.nl80211 import Tuned, tuned
from companion.radio.opening import macs, open_csi
from companion.radio.pinger import MONITOR
from csi_bridge.netlink import ConnectorProbe, connector_available
from wsr.channel import channel_frequency_hz, wide_channel

_LOG_CSI: Final = 0x01
_MIN_RATE_HZ: Final = 40.0
_LOCK_SPAN_S: Final = 1.0
_BIG_STEP_DB: Final = 15.0


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the report. `ok` None: could not be looked at."""

    name: str
    ok: bool | None
    found: str
    remedy: str = ""


@dataclass(frozen=True, slots=True)
class System:
    """Where the kernel shows its state; other folders in tests."""

    modules: Path = Path("/sys/module")
    networks: Path = Path("/sys/class/net")
    debug: Path = Path("/sys/kernel/debug")
    phys: Path = Path("/sys/class/ieee80211")


def static_checks(config: Config, system: System) -> Iterator[Check]:
    """What can be read without waiting for packets."""
    if config.csi.source == "unix":
        yield Check("driver", None, "csi.source is unix: the records come from a process, not from a driver")
    elif config.csi.source == "netlink":
        yield _module(system)
        reason = connector_available(config.csi.connector_idx)
        yield Check(
            "connector", reason is None, reason or f"group {config.csi.connector_idx} delivers",
            "" if reason is None else "run as root or with CAP_NET_ADMIN on a kernel with CONFIG_CONNECTOR",
        )  # fmt: skip
        yield _log_mask(system)
    yield from _interface(config, system)


async def live_checks(config: Config, seconds: float, on_progress: Callable[[float], None]) -> list[Check]:
    """Listens to the card for a while. Raises CompanionError when the source cannot be opened."""
    source, heard = open_csi(config), dict.fromkeys((peer.id for peer in config.peers), 0)

    def count(sample: ChannelSample) -> None:
        heard[sample.peer] += 1

    radio = Radio(source=source, peers=macs(config), clock=MonotonicClock(), on_sample=count, on_record=lambda *_: None)
    probe = ConnectorProbe() if config.csi.source == "netlink" else None
    loop = asyncio.get_running_loop()
    loop.add_reader(source.fileno(), radio.drain)
    if probe is not None:
        loop.add_reader(probe.fileno(), probe.drain)
    start_s = time.monotonic()
    try:
        while (waited_s := time.monotonic() - start_s) < seconds:
            on_progress(waited_s / seconds)
            await asyncio.sleep(0.1)
    finally:
        loop.remove_reader(source.fileno())
        source.close()
        if probe is not None:
            loop.remove_reader(probe.fileno())
            probe.close()
    elsewhere = {} if probe is None else {idx: n for idx, n in probe.heard.items() if idx != config.csi.connector_idx}
    return list(_heard(config, radio, heard, seconds, refused=source.counters.refused_sender, elsewhere=elsewhere))


def _module(system: System) -> Check:
    if not (system.modules / "iwldvm").is_dir():
        return Check("driver", False, "the module iwldvm is not loaded", "modprobe iwlwifi connector_log=0x1")
    if not (system.modules / "iwlwifi" / "parameters" / "connector_log").exists():
        return Check(
            "driver", False, "iwlwifi has no parameter connector_log: it is the stock driver",
            "install the patched driver of the 802.11n CSI Tool and reload it",
        )  # fmt: skip
    return Check("driver", True, "patched iwlwifi is loaded")


def _log_mask(system: System) -> Check:
    places = [
        *system.debug.glob("ieee80211/phy*/iwlwifi/iwldvm/debug/connector_log"),
        system.modules / "iwlwifi" / "parameters" / "connector_log",
    ]
    for place in places:
        try:
            mask = int(place.read_text().strip(), 0)
        except (OSError, ValueError):
            continue
        ok = bool(mask & _LOG_CSI)
        return Check("connector_log", ok, f"{mask:#x}", "" if ok else f"echo 0x1 > {place}")
    return Check("connector_log", None, "cannot be read", "mount -t debugfs none /sys/kernel/debug, as root")


def _interface(config: Config, system: System) -> Iterator[Check]:
    name = config.csi.interface
    if name is None:
        yield Check(
            "interface", None, "csi.interface is not configured", "name the monitor interface, for example mon0"
        )
        return
    folder = system.networks / name
    try:
        kind = int((folder / "type").read_text())
        state = (folder / "operstate").read_text().strip()
    except (OSError, ValueError):
        yield Check("interface", False, f"{name} is not there", f"iw phy phy0 interface add {name} type monitor")
        return
    yield Check(
        "interface", kind == MONITOR, f"{name} is {'in' if kind == MONITOR else 'not in'} monitor mode",
        "" if kind == MONITOR else f"ip link set {name} down; iw dev {name} set type monitor; ip link set {name} up",
    )  # fmt: skip
    yield Check("interface up", state != "down", state, "" if state != "down" else f"ip link set {name} up")
    yield from _channel(config, name)


def channel_words(csi: CsiConfig) -> tuple[str, str]:
    """Number and width of the channel as `iw dev NAME set channel` takes them."""
    width = {20: "HT20", 80: "80MHz", 160: "160MHz"}.get(csi.width_mhz)
    if width is None:
        width = "HT40+" if wide_channel(csi.channel, csi.width_mhz) > csi.channel else "HT40-"
    return str(csi.channel), width


def _channel(config: Config, name: str) -> Iterator[Check]:
    csi = config.csi
    wanted, remedy = round(channel_frequency_hz(csi.channel) / 1e6), f"iw dev {name} set channel "
    remedy += " ".join(channel_words(csi))
    try:
        found = tuned(name)
    except OSError as error:
        yield Check("channel", None, f"cannot be asked: {error.strerror or error}", f"iw dev {name} info")
        return
    yield from tuned_checks(csi, wanted, found, remedy)


def tuned_checks(csi: CsiConfig, wanted_mhz: int, found: Tuned | None, remedy: str) -> Iterator[Check]:
    """What the interface is set to against what the configuration wants."""
    if found is None:
        yield Check("channel", False, "none is set", remedy)
        return
    ok = found.primary_mhz == wanted_mhz
    told = f"{found.primary_mhz} MHz, csi.channel {csi.channel} is {wanted_mhz} MHz"
    yield Check("channel", ok, told, "" if ok else remedy)
    if found.width_mhz is None:
        yield Check("channel width", None, "the kernel does not say", f"iw dev {csi.interface} info")
        return
    ok = found.width_mhz == csi.width_mhz
    yield Check("channel width", ok, f"{found.width_mhz} MHz, csi.width_mhz is {csi.width_mhz}", "" if ok else remedy)


def _heard(
    config: Config, radio: Radio, heard: dict[int, int], seconds: float, *, refused: int, elsewhere: dict[int, int]
) -> Iterator[Check]:
    counters = radio.counters
    moving = "" if counters.records else "are frames on the air? start the beacons, or ping them (ping.enabled)"
    if refused and not counters.records:
        moving = f"{refused} records came from a process: csi.require_kernel_sender refuses those"
    elif elsewhere and not counters.records:
        groups = ", ".join(f"{count} in group {idx}" for idx, count in sorted(elsewhere.items()))
        moving = f"records came elsewhere: {groups}; set csi.connector_idx to the driver's"
    yield Check(
        "counters",
        counters.records > 0,
        f"{counters.records} records, {counters.lost} counted by the driver and never seen",
        moving,
    )
    if not counters.records:
        return
    yield _antennas(radio)
    for peer in config.peers:
        rate_hz = heard[peer.id] / seconds
        ok = rate_hz >= _MIN_RATE_HZ
        hint = f"is {peer.mac} its MAC? {counters.unknown_sender} records came from unknown ones" if not ok else ""
        yield Check(f"packets of {peer.name}", ok, f"{rate_hz:.0f} a second, at least {_MIN_RATE_HZ:.0f} wanted", hint)
    clock = radio.nic_clock
    ok = clock.resets == 0 and clock.span_s >= min(_LOCK_SPAN_S, 0.4 * seconds)
    yield Check(
        "clock lock", ok, f"{clock.span_s:.1f} s of packets, {clock.resets} resets of the card's clock",
        "" if ok else "the driver restarts, or the host stalls: see dmesg",
    )  # fmt: skip


def _antennas(radio: Radio) -> Check:
    powers = {name: power for name, power in radio.antenna_power().items() if power is not None}
    listed = ", ".join(f"{name} {power:.0f} dBm" for name, power in powers.items()) or "none"
    weak = [name for name, power in powers.items() if power < max(powers.values()) - _BIG_STEP_DB]
    note = f"; {', '.join(weak)} as good as unconnected (one is enough)" if weak else ""
    return Check("antennas", bool(powers), listed + note, "" if powers else "no antenna reports power: check the leads")


def failed(checks: list[Check]) -> None:
    """Raises CompanionError that names what is wrong, if anything is."""
    wrong = dict.fromkeys(check.name for check in checks if check.ok is False)
    if wrong:
        raise CompanionError(f"not ready: {', '.join(wrong)}")
