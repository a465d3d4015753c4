"""Whether this robot's card and the other's keep their phase from packet to packet: measured while both stand still."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from typing import Final

from companion.config.schema import Config
from companion.core.clock import NS_PER_S, MonotonicClock
from companion.diagnosis.network import receiver_of
from companion.neighbours.link import Link
from companion.neighbours.neighbour import Neighbour
from companion.radio.card import Radio
from companion.radio.checks import Check
from companion.radio.opening import macs, open_csi
from companion.sensing.window import SarWindow
from wsr.channel import wavelength_m
from wsr.coherence import rest_spread_rad
from wsr.errors import ApertureError

_GOOD_DEG: Final = 15.0
_USABLE_DEG: Final = 30.0
_LEAST: Final = 50
_LOOK_S: Final = 0.05


async def rest_checks(config: Config, seconds: float, on_progress: Callable[[float], None]) -> list[Check]:
    """A line for each peer, from what card and network bring in `seconds`. Raises CompanionError when the card, the
    network or a key cannot be opened."""
    clock, receiver = MonotonicClock(), receiver_of(config)
    window = SarWindow(
        antenna_m=config.pose.antenna_m,
        wavelength_m=wavelength_m(config.csi.channel),
        min_packets=1,
        max_pose_gap_s=1.0,
    )
    link = Link(config)
    try:
        source = open_csi(config)
        radio = Radio(
            source=source, peers=macs(config), clock=clock, on_sample=window.add_sample, on_record=lambda *_: None
        )
        try:
            start_ns, start_s = clock.now_ns(), time.monotonic()
            while (waited_s := time.monotonic() - start_s) < seconds:
                on_progress(waited_s / seconds)
                radio.drain()
                for data in link.drain():
                    receiver.take(data)
                await asyncio.sleep(_LOOK_S)
        finally:
            source.close()
    finally:
        link.close()
    end_ns = clock.now_ns() + NS_PER_S
    return [_at_rest(window, neighbour, start_ns, end_ns) for neighbour in receiver.neighbours.values()]


def _at_rest(window: SarWindow, neighbour: Neighbour, start_ns: int, end_ns: int) -> Check:
    name = f"phase at rest to {neighbour.name}"
    if not neighbour.accepted:
        return Check(name, None, "its datagrams do not arrive", "start its service: it sends what it heard")
    try:
        pairs = window.paired(neighbour, start_ns, end_ns)
    except ApertureError as error:
        return Check(name, None, str(error))
    if len(pairs.ours) < _LEAST:
        return Check(name, None, f"{len(pairs.ours)} exchanges, at least {_LEAST} wanted", "listen longer: --seconds")
    spread_deg = math.degrees(
        rest_spread_rad(
            pairs.ours, pairs.theirs, pairs.nic_us, pairs.wavelength_m, grid=pairs.grid, half_turns=pairs.half_turns
        )
    )
    found = f"spreads by {spread_deg:.1f} degrees over {len(pairs.ours)} exchanges"
    if spread_deg <= _GOOD_DEG:
        return Check(name, True, f"{found}: coherent")
    if spread_deg <= _USABLE_DEG:
        return Check(name, True, f"{found}: coherent enough; below {_GOOD_DEG:.0f} bearings are better")
    return Check(
        name, False, f"{found}: no aperture can be made of that",
        "do both robots stand, and nobody walks between? else this card does not keep its phase",
    )  # fmt: skip
