"""The interactive part of a report: the page's own panels with a slider over the flight, and its summary in words."""

from __future__ import annotations

import math
from importlib import resources
from typing import Any, Final

import msgspec
import numpy as np

from companion.report.content import FlightContent
from companion.report.outcome import Closest, outcome

_SCRIPTS: Final = ("colours.js", "draw.js", "panels.js", "scrub.js")


def scrubbing(content: FlightContent) -> str:
    """HTML with everything in it: styles, scripts and the flight's data."""
    assert content.timeline is not None
    data = msgspec.json.encode(content.timeline.content(_truth(content))).decode()
    data = data.replace("<", "\\u003c")  # what a log says must not end the script it stands in
    scripts = "\n".join(f"<script>{_asset(name)}</script>" for name in _SCRIPTS)
    return (
        f"<style>{_asset('page.css')}</style>\n"
        '<p class="scrub"><button id="play" type="button">Play</button> '
        f'<input id="moment" type="range" min="0" max="{content.duration_s:.1f}" step="0.1" '
        f'value="{content.duration_s:.1f}" aria-label="time of the flight"> <output id="time"></output></p>\n'
        '<div id="panels"></div>\n'
        "<noscript><p>This section needs JavaScript; the pictures below do not.</p></noscript>\n"
        f'<script type="application/json" id="flight">{data}</script>\n{scripts}'
    )


def summary_of(content: FlightContent) -> str:
    """One sentence: how the flight went and why it ended."""
    if content.config.role == "beacon":
        return f"A beacon's log: it served for {content.duration_s:.0f} s."
    bearings = sum(one.estimate is not None for one in content.iterations)
    return outcome(content.steps, _closest(content), bearings, content.duration_s)


def azimuth_errors_deg(content: FlightContent) -> list[float]:
    """Estimate less truth of each bearing, with its sign; NaN where either is not known."""
    errors = []
    for one in content.iterations:
        truth = content.true_bearing(one)
        if one.estimate is not None:
            known = truth is not None and one.estimate.azimuth_observable
            turn = math.remainder(one.estimate.azimuth_rad - truth[0], math.tau) if truth and known else math.nan
            errors.append(math.degrees(turn))
    return errors


def _closest(content: FlightContent) -> Closest:
    end_s = next((t_s for t_s, state in content.states if state == "arrived"), content.duration_s)
    true = content.true_distances()
    until = [d for t_s, d in true if t_s <= end_s]
    believed = [report["target"] for t_s, report in content.targets if t_s <= end_s]
    last: dict[str, Any] = believed[-1] if believed else {}
    return Closest(
        end_m=until[-1] if until else None,
        nearest_m=min(until, default=None),
        believed_m=last.get("range_m"),
        believed_std_m=last.get("range_std_m"),
    )


def _truth(content: FlightContent) -> dict[str, Any]:
    """Distance over time, and where the robots truly are, moved to where the vehicle's true and estimated places
    agree."""
    distance = [[round(t_s, 1), round(d, 2)] for t_s, d in content.true_distances()]
    if not distance:
        return {}
    t_s = (content.truth.t_ns + content.session.wall_minus_mono_ns - content.start_ns) / 1e9
    shift = np.zeros(3)
    if content.vehicle_m:
        at = np.array(content.vehicle_t_s)
        seen = np.stack([np.interp(at, t_s, content.truth.antenna_m[:, axis]) for axis in range(3)], axis=1)
        shift = np.median(np.array(content.vehicle_m) - seen, axis=0)
    places = [
        {"name": name, "p_m": [round(value, 2) for value in (p_m[-1] + shift).tolist()]}
        for name, p_m in content.truth.peers_m.items()
        if np.isfinite(p_m[-1]).all()
    ]
    return {"distance": distance, "places": places}


def _asset(name: str) -> str:
    text = resources.files("companion.page").joinpath("assets", name).read_text("utf-8")
    assert "</script" not in text
    return text
