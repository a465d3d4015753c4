"""What a page costs, in shares of a core: all streams of a flight live, a browser that takes five pictures a second."""

from __future__ import annotations

import http.client
import itertools
import os
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

import numpy as np

from benchmarks.recorder import drive, flight_messages
from companion.config.file import load_config
from companion.core.clock import MonotonicClock
from companion.core.event_clock import EventClock
from companion.core.messages import VehicleState
from companion.core.streams import BEARING, HEALTH, PROFILE, VEHICLE
from companion.log.feed import introduction
from companion.log.records import LoggedEstimate, LoggedIteration
from companion.replay.live_page import LivePage

_ROOT: Final = Path(__file__).resolve().parents[1]
_BEARINGS_HZ: Final = 2.0
"""As often as an estimate is made at most (aperture.period_s)."""
_SPEED_M_S: Final = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class PageCost:
    """Shares of one core over `seconds`: of the page's process, of the service's thread that feeds it, and of the
    calls in the control loop."""

    seconds: float
    process_share: float
    feed_share: float
    calls_share: float
    process_mb: float
    """Resident."""
    pictures: int
    kilobytes_per_s: float
    """To the browser."""
    dropped: int
    longest_call_us: float


def page_cost(seconds: float = 20.0, has_viewer: bool = True) -> PageCost:
    """Feeds a page for `seconds`."""
    clock = EventClock(MonotonicClock())
    with LivePage(introduction(load_config(_ROOT / "configs" / "uav.yaml"), "live"), 0) as page:
        viewer = _Viewer(page.url)
        if has_viewer:
            viewer.start()
        feeder = next(thread for thread in threading.enumerate() if thread.name == "page feed")
        assert feeder.ident is not None
        feed_clock = time.pthread_getcpuclockid(feeder.ident)
        time.sleep(1.0)  # the browser's first, larger picture is not counted
        viewer.count, viewer.size = 0, 0
        feed_s, process_s = time.clock_gettime(feed_clock), _processor_s(page.pid)
        calls_s, longest_us = drive(page.feed, clock, seconds, _messages())
        feed_s, process_s = time.clock_gettime(feed_clock) - feed_s, _processor_s(page.pid) - process_s
        return PageCost(
            seconds=seconds,
            process_share=process_s / seconds,
            feed_share=feed_s / seconds,
            calls_share=calls_s / seconds,
            process_mb=_resident_mb(page.pid),
            pictures=viewer.count,
            kilobytes_per_s=viewer.size / seconds / 1e3,
            dropped=page.feed.dropped,
            longest_call_us=longest_us,
        )


class _Viewer(threading.Thread):
    """Reads a page's events, as a browser does."""

    def __init__(self, url: str) -> None:
        super().__init__(daemon=True)
        self._host = urlsplit(url).netloc
        self.count = self.size = 0

    def run(self) -> None:
        connection = http.client.HTTPConnection(self._host)
        connection.request("GET", "/events")
        answer = connection.getresponse()
        while line := answer.readline():
            self.size += len(line)
            self.count += line == b"event: view\n"


def _messages() -> tuple[Any, ...]:
    estimate = LoggedEstimate(azimuth_rad=1.0, polar_rad=1.5, reliability=0.8, packets=480, length_m=1.2)
    vehicle = next(message for stream, _, message in flight_messages() if stream is VEHICLE)
    assert isinstance(vehicle, VehicleState)
    numbers, steps = itertools.count(), itertools.count()

    def iteration() -> LoggedIteration:
        return LoggedIteration(
            number=next(numbers), peer=2, start_ns=1, end_ns=2, reference_ns=1, received=500, estimate=estimate,
            refusal="", p_local_enu_m=(1.0, 2.0, 3.0),
        )  # fmt: skip

    def moving() -> VehicleState:
        return replace(vehicle, p_local_enu_m=(_SPEED_M_S / 20 * next(steps), 0.0, 1.5))

    power = np.random.default_rng(1).random((180, 360)).astype(np.float16).tobytes()
    health = {"pose_age_s": 0.01, "poses": {"rate_hz": 200.0}, "neighbours": {}, "recorder": {"written": 1}}
    steady = tuple(one for one in flight_messages() if one[0] not in (PROFILE, VEHICLE))
    return (
        *steady,
        (VEHICLE, 20.0, moving),
        (BEARING, _BEARINGS_HZ, iteration),
        (PROFILE, _BEARINGS_HZ, power),
        (HEALTH, 1.0, health),
    )


def _processor_s(pid: int) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _resident_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
