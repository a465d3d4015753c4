"""An imported recording on the same page: the receiving robot's path, then each transmitter's bearing and profile."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from companion.analysis.result import LinkResult, RunResult
from companion.core.clock import NS_PER_S
from companion.core.messages import Vector3
from companion.core.streams import BEARING, LOG, PROFILE, TICK, VEHICLE
from companion.errors import CompanionError
from companion.log.feed import PERIOD_S, Feed
from companion.log.lines import LogLine
from companion.log.records import LoggedEstimate, LoggedIteration
from companion.replay.live_page import LivePage

_POINTS: Final = 40
"""Of the path, one a picture."""
_EACH_S: Final = 2.0
"""A transmitter's bearing is shown for so long before the next one's."""
_PEER: Final = 1
Floats = npt.NDArray[np.float64]


def show_recording(
    result: RunResult,
    path_m: Floats,
    name: str,
    port: int,
    *,
    announce: Callable[[str], None],
    stay: Callable[[], None],
) -> None:
    """Shows what `analyze` found; `path_m` (N, 3) is where the receiving robot was. `announce` is told the address,
    `stay` returns when the page may go. Raises CompanionError when the port is taken or there is nothing to show."""
    links = [link for link in result.links if link.estimate is not None and link.profile is not None]
    path_m = path_m[np.isfinite(path_m).all(axis=1)]
    if not links or not len(path_m):
        raise CompanionError(f"{name}: no bearing to show")
    with LivePage(_about(name), port) as page:
        announce(page.url)
        page.wait_for_viewer()
        pause, t_ns = threading.Event(), 0
        for place in path_m[:: max(1, len(path_m) // _POINTS)].tolist():
            t_ns += round(PERIOD_S * NS_PER_S)
            page.feed.note(TICK, t_ns, None)
            page.feed.note(VEHICLE, t_ns, {"p_local_enu_m": place})
            pause.wait(PERIOD_S)
        middle = path_m.mean(axis=0).tolist()
        for number, link in enumerate(links, 1):
            t_ns += round(_EACH_S * NS_PER_S)
            page.feed.note(TICK, t_ns, None)
            _show_link(page.feed, t_ns, number, link, place=(middle[0], middle[1], middle[2]))
            pause.wait(_EACH_S)
        page.end(t_ns)
        stay()


def _about(name: str) -> dict[str, Any]:
    """A recording's introduction: it has neither a mission nor a fence."""
    return {
        "name": name, "role": "recording", "source": name, "control": "observe", "peers": {}, "target": _PEER,
        "fence": None, "mission": {},
    }  # fmt: skip


def _show_link(feed: Feed, t_ns: int, number: int, link: LinkResult, *, place: Vector3) -> None:
    found = link.estimate
    assert found is not None and link.profile is not None
    estimate = LoggedEstimate(
        azimuth_rad=found.azimuth_rad, polar_rad=found.polar_rad, reliability=found.reliability,
        packets=found.packets, length_m=found.length_m, azimuth_observable=found.azimuth_observable,
        polar_observable=found.polar_observable, azimuth_std_rad=found.azimuth_std_rad,
        polar_std_rad=found.polar_std_rad,
    )  # fmt: skip
    iteration = LoggedIteration(
        number=number, peer=_PEER, start_ns=t_ns, end_ns=t_ns, reference_ns=t_ns, received=link.packets,
        estimate=estimate, refusal="", p_local_enu_m=place,
    )  # fmt: skip
    feed.note(BEARING, t_ns, iteration)
    feed.note(PROFILE, t_ns, link.profile.power)
    error = link.azimuth_error_rad
    truth = "" if error is None else f", {math.degrees(error):+.1f}° off the truth"
    text = f"bearing {number}: azimuth {math.degrees(found.azimuth_rad):.1f}°{truth}"
    feed.note(LOG, t_ns, LogLine(logging.WARNING, link.name, text))
