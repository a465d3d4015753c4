"""The report: one page that needs nothing from elsewhere, renders, scrubs, and can be told apart in grey."""

from __future__ import annotations

import math
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from PIL import Image

from companion.core.streams import BEARING, PROFILE
from companion.log.encoding import encoded, schema_of
from companion.log.reader import LoggedMessage, open_session
from companion.log.records import LoggedIteration
from companion.log.repair import copy
from companion.log.truth import TRUTH_NAME, Truth, write_truth
from companion.log.writer import LogWriter
from companion.report.content import gather
from companion.report.page import figures, flight_page
from tests.browser_session import Session
from tests.golden.golden_logs import GOLDEN
from tests.paths import ROOT
from wsr.directions import AZIMUTH_RAD, POLAR_RAD
from wsr.geometry import direction

SECTIONS = (
    "The flight, moment by moment", "Distance to the target",
    "Flight path and bearings", "AOA profiles", "Error, bound, reliability", "SAR iterations", "Rates", "Health",
    "Events", "Configuration",
)  # fmt: skip
_STATE = "document.getElementById('state')?.textContent"
_BEARING = "document.getElementById('bearing').textContent"
_MOVE = """(() => { const one = document.getElementById('moment'); one.value = TIME;
  one.dispatchEvent(new Event('input')); })()"""
_HEAT = """(() => { const one = document.querySelector('canvas[aria-label^="heat map"]'), pen = one.getContext('2d');
  return new Set(new Uint32Array(pen.getImageData(0, 0, one.width, one.height).data.buffer)).size; })()"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of the golden flight with a truth beside it, and a profile with each bearing, which a golden log has
    not: replayed it would have, for as much processor as all tests of this page together."""
    folder = tmp_path_factory.mktemp("report")
    golden = open_session(GOLDEN[0])
    log = folder / "log.mcap"
    start_ns = 0
    with log.open("wb") as file:
        writer = LogWriter(file, golden.metadata)
        for message in golden.messages():
            start_ns = start_ns or message.log_time_ns - golden.wall_minus_mono_ns
            copy(writer, message)
            if message.topic == BEARING.topic:
                data, source = encoded(PROFILE, message.log_time_ns, _profile_of(message))
                times = (message.log_time_ns, message.publish_time_ns)
                writer.copy(
                    PROFILE.topic, PROFILE.encoding, schema_of(source), times, sequence=message.sequence, data=data
                )
        writer.finish()
    azimuth_rad = math.radians(-60.53)  # where the demo's seed 1 places the beacon, 15 m from the start
    beacon = {"beacon": (15 * math.cos(azimuth_rad), 15 * math.sin(azimuth_rad), 0.3)}
    truths = [Truth(start_ns + k * 50_000_000, (0.0, 0.0, 1.5), beacon) for k in range(-400, 1200)]
    write_truth(folder / TRUTH_NAME, truths)
    out = folder / "report.html"
    content = gather(open_session(log))
    assert content.truth
    out.write_text(flight_page(content))
    numbers = figures(content)
    assert len(numbers["errors_deg"]) == 12
    assert all(error < 10 for error in numbers["errors_deg"])
    return out


def _profile_of(bearing: LoggedMessage) -> bytes:
    """One lobe where the bearing points, as an AOA worker sends it."""
    estimate = msgspec.json.decode(bearing.data, type=LoggedIteration).estimate
    assert estimate is not None
    towards = direction(estimate.azimuth_rad, estimate.polar_rad)
    power = np.exp(40.0 * (direction(AZIMUTH_RAD[None, :], POLAR_RAD[:, None]) @ towards - 1.0))
    return np.asarray(power, np.float16).tobytes()


def test_the_page_says_everything_and_loads_nothing(page: Path) -> None:
    text = page.read_text()
    for title in SECTIONS:
        assert f"<h2>{title}</h2>" in text
    assert text.count('src="data:image/png;base64,') == 6
    assert not re.search(r"https?://|<script[^>]*src|<link(?![^>]*data:)|@import|url\(", text)
    assert "estimator: robust" in text  # the configuration
    assert "idle -&gt; preflight on engage" in text
    assert re.search(r"<h1>Flight of uav</h1>\s*<p><strong>Did not reach the target: the log ends while", text)
    assert len(text) < 2e6


def test_a_browser_scrubs_through_the_flight_without_errors_and_without_asking_anybody(
    page: Path, tmp_path: Path
) -> None:
    """At its start nothing is known, at its end everything; without the panels no colour is left."""
    with Session(tmp_path) as browser:
        browser.size(1200, 1800)
        browser.open(page.as_uri())
        browser.until(_STATE)
        assert browser.value(_STATE) == "approaching"
        assert "Compass" in browser.value(_BEARING)
        browser.value(_MOVE.replace("TIME", "0"))
        assert browser.value(_STATE) == "idle"
        assert "No bearing yet" in browser.value(_BEARING)
        browser.value(_MOVE.replace("TIME", "1000"))
        browser.until(_HEAT, lambda colours: colours > 20)
        browser.screenshot(ROOT / "build" / "screens" / "report-desktop.png")
        assert browser.value("document.querySelectorAll('body > section').length") == len(SECTIONS)
        assert browser.console == [] and browser.outside() == []
        browser.value("document.querySelector('.scrub').remove(); document.getElementById('panels').remove()")
        browser.screenshot(tmp_path / "page.png", is_whole=True)
        browser.size(390, 844, is_phone=True)
        browser.open(page.as_uri())
        browser.until(_STATE)
        browser.screenshot(ROOT / "build" / "screens" / "report-phone.png")
        assert browser.value("document.getElementById('panels').scrollWidth") <= 390
    pixels = np.asarray(Image.open(tmp_path / "page.png").convert("RGB"), int)
    assert np.ptp(pixels, axis=2).max() <= 8
    assert (pixels < 60).any()
