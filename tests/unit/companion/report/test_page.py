"""The report: one page that needs nothing from elsewhere, renders, and can be told apart in black and white."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from companion.log.reader import open_session
from companion.log.truth import TRUTH_NAME, Truth, write_truth
from companion.report.content import gather
from companion.report.page import figures, flight_page
from tests.browser import screenshot, visit
from tests.golden.golden_logs import GOLDEN

SECTIONS = (
    "Flight path and bearings", "AOA profiles", "Error, bound, reliability", "SAR iterations", "Rates", "Health",
    "Events", "Configuration",
)  # fmt: skip


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a replayed flight (so that it has profiles) with a truth beside it."""
    from companion.replay.player import Player
    from companion.replay.result import replay_log, write_decided

    folder = tmp_path_factory.mktemp("report")
    golden = open_session(GOLDEN[0])
    with Player(golden, golden.config(), exact=True) as player:
        result = replay_log(player, golden, None)
    log = folder / "log.mcap"
    from companion.log.repair import copy
    from companion.log.writer import LogWriter
    from companion.replay.player import INPUT_TOPICS

    with log.open("wb") as file:
        writer = LogWriter(file, golden.metadata)
        for message in golden.messages(INPUT_TOPICS):
            copy(writer, message)
        for one in result.decided:
            write_decided(writer, one, golden.wall_minus_mono_ns)
        writer.finish()
    start_ns = result.start_ns
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


def test_the_page_says_everything_and_loads_nothing(page: Path) -> None:
    text = page.read_text()
    for title in SECTIONS:
        assert f"<h2>{title}</h2>" in text
    assert text.count('src="data:image/png;base64,') == 5
    assert not re.search(r"https?://|<script|<link(?![^>]*data:)|@import|url\(", text)
    assert "estimator: robust" in text  # the configuration
    assert "idle -&gt; preflight on engage" in text


def test_it_renders_in_a_browser_without_errors_and_without_asking_anybody(page: Path, tmp_path: Path) -> None:
    seen = visit(page.as_uri(), tmp_path)
    assert seen.console == []
    assert seen.outside == []
    assert seen.dom.count("<section>") == len(SECTIONS)


def test_it_is_readable_in_black_and_white(page: Path, tmp_path: Path) -> None:
    """Nothing on the page has a colour, so nothing can be lost without one."""
    if shutil.which("chromium") is None:
        pytest.skip("no /usr/bin/chromium here (apt-get install chromium)")
    screenshot(page.as_uri(), tmp_path / "page.png", tmp_path)
    pixels = np.asarray(Image.open(tmp_path / "page.png").convert("RGB"), int)
    assert np.ptp(pixels, axis=2).max() <= 8
    assert (pixels < 60).any()
