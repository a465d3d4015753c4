"""What the card needs from root once: monitor mode, channel, the driver's switches. `companion-radio.service` does it,
so that the services themselves run without.

`steps` says what is to be done on this machine, `CardStep.take` does one. Done twice it changes nothing.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from companion.config.schema import Config
from companion.errors import CompanionError
from companion.radio.checks import System, channel_words
from companion.radio.pinger import MONITOR

_TIMEOUT_S: Final = 10
_DRIVERS: Final = {"netlink": "iwldvm", "nl80211": "iwlmvm"}
"""The half of iwlwifi that drives the card of each csi.source: Intel 5300, AX200 and AX210."""
_HT_ANTENNA_A: Final = 0x4100
"""monitor_tx_rate of the 802.11n CSI Tool: HT, one stream from antenna A; the MCS is added."""


@dataclass(frozen=True, slots=True)
class CardStep:
    """A command to run or, with `text`, a switch of the driver to write."""

    words: tuple[str, ...]
    text: str = ""

    def __str__(self) -> str:
        return f"echo {self.text} > {self.words[0]}" if self.text else " ".join(self.words)

    def take(self) -> None:
        """Raises CompanionError with what the kernel or the program says."""
        if self.text:
            self._write()
            return
        try:
            done = subprocess.run(self.words, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
        except FileNotFoundError:
            raise CompanionError(f"{self.words[0]}: not installed; apt install iw iproute2") from None
        except subprocess.TimeoutExpired:
            raise CompanionError(f"{self}: not done within {_TIMEOUT_S} s") from None
        if done.returncode:
            raise CompanionError(f"{self}: {' '.join(done.stderr.split()) or f'exit code {done.returncode}'}")

    def _write(self) -> None:
        try:
            Path(self.words[0]).write_text(self.text)
        except OSError as error:
            raise CompanionError(f"{self}: {error.strerror}") from None


def steps(config: Config, system: System) -> Iterator[CardStep]:
    """In their order. Raises CompanionError when the card or its patched driver is not there."""
    driver = _DRIVERS.get(config.csi.source)
    if driver is None:
        return
    card = _card(driver, config.csi.source, system)
    if config.csi.interface is not None:
        yield from _monitor(config, config.csi.interface, card.parents[1].name, system)
    yield from _switches(config, card, system)


def _card(driver: str, source: str, system: System) -> Path:
    """The driver's folder in debugfs, .../phy0/iwlwifi/iwldvm."""
    found = sorted(system.debug.glob(f"ieee80211/phy*/iwlwifi/{driver}"))
    if not found:
        raise CompanionError(
            f"csi.source {source}: no card with the driver {driver} below {system.debug}, which root alone can see "
            "where debugfs is mounted; companion doctor radio says more"
        )
    return found[0]


def _monitor(config: Config, name: str, phy: str, system: System) -> Iterator[CardStep]:
    siblings = sorted(path.name for path in (system.phys / phy / "device" / "net").glob("*"))
    if config.neighbours.interface in siblings:
        raise CompanionError(
            f"neighbours.interface {config.neighbours.interface}: an interface of the card that measures, which cannot "
            "carry the robots' network; expected one of another card"
        )
    for other in siblings:
        if other != name:  # an interface that is up holds the card to its own channel
            yield CardStep(("ip", "link", "set", other, "down"))
    kind = system.networks / name / "type"
    if not kind.exists():
        yield CardStep(("iw", "phy", phy, "interface", "add", name, "type", "monitor"))
    elif kind.read_text().strip() != str(MONITOR):
        yield CardStep(("ip", "link", "set", name, "down"))
        yield CardStep(("iw", "dev", name, "set", "type", "monitor"))
    yield CardStep(("ip", "link", "set", name, "up"))
    yield CardStep(("iw", "dev", name, "set", "channel", *channel_words(config.csi)))


def _switches(config: Config, card: Path, system: System) -> Iterator[CardStep]:
    if config.csi.source == "nl80211":
        yield _switch([card / "csi_enabled"], "1", "the driver of FeitCSI")
        return
    parameter = system.modules / "iwlwifi" / "parameters" / "connector_log"
    yield _switch([card / "debug" / "connector_log", parameter], "0x1", "the driver of the 802.11n CSI Tool")
    if config.ping.enabled:
        rate = f"{_HT_ANTENNA_A | config.ping.mcs:#x}"
        yield _switch([card / "debug" / "monitor_tx_rate"], rate, "the driver of the 802.11n CSI Tool")


def _switch(places: list[Path], text: str, driver: str) -> CardStep:
    place = next((place for place in places if place.exists()), None)
    if place is None:
        raise CompanionError(f"{places[0]}: there is no such switch; expected {driver}, this is the stock one")
    return CardStep((str(place),), text)
