"""One self-contained HTML page: no fonts, no scripts, no pictures from anywhere else."""

from __future__ import annotations

import base64
import html
import json
import math
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
import yaml

from companion.analysis.imported import ImportedScene
from companion.analysis.result import LinkResult, RunResult
from companion.analysis.summary import note_lines, problem_lines
from companion.log.reader import Session
from companion.page.parts import elevation_deg
from companion.report import pictures
from companion.report.content import FlightContent
from companion.report.moments import azimuth_errors_deg, scrubbing, summary_of
from companion.report.outcome import shared_sign

_STYLE = """body{font:15px/1.45 sans-serif;max-width:70em;margin:1em auto;padding:0 1em;color:#000;background:#fff}
img{max-width:100%}table{border-collapse:collapse;font-size:13px}td,th{border:1px solid #999;padding:.15em .6em;
text-align:right}td.l,th.l{text-align:left}pre{background:#f3f3f3;border:1px solid #bbb;padding:.6em;font-size:12px;
white-space:pre-wrap}.scroll{overflow-x:auto}h2{border-bottom:1px solid #000;margin-top:1.6em}
@media print{h2{break-after:avoid}img,tr{break-inside:avoid}}"""

_MOST_TILES = 24
Cell = str | float | int | None


def flight_page(content: FlightContent) -> str:
    """The page of a flight."""
    session = content.session
    sections = [
        _section("The flight, moment by moment", scrubbing(content)),
        _section("Distance to the target", _image(pictures.distance(content), "distance to the target over time")),
        _section("Flight path and bearings", _image(pictures.flight_path(content), "path from above with bearings")),
        _section(
            "AOA profiles",
            "<p>Azimuth (from East) across, elevation above the horizon up, dark where the power is high; a circle is "
            "the estimate, a cross the truth.</p>" + _profile_image(content),
        ),
        _section(
            "Error, bound, reliability",
            _words(shared_sign(azimuth_errors_deg(content)))
            + _image(pictures.estimates(content), "error and reliability over time"),
        ),
        _section("SAR iterations", _iteration_table(content)),
        _section("Rates", _image(pictures.rates(content), "packet, pairing and set point rates")),
        _section("Health", _image(pictures.health(content), "health over time")),
        _section("Events", _event_table(content)),
        _section("Configuration", _config(content)),
    ]
    summary = f"<p><strong>{html.escape(summary_of(content))}</strong></p>"
    return _page(f"Flight of {content.config.name}", summary + _summary(session, _flight_facts(content)), sections)


def recording_page(session: Session, scene: ImportedScene, result: RunResult, path_png: bytes) -> str:
    """The page of an imported recording."""
    estimated = [link for link in result.links if link.estimate is not None and link.profile is not None]
    tiles = [(link.name, link.profile.power, _found(link), _truth(link)) for link in estimated if link.profile]
    problems = "".join(f"<li>{html.escape(line)}</li>" for line in (*note_lines(result), *problem_lines(result)))
    sections = [
        _section("Path and bearings", _image(path_png, "path from above with bearings")),
        _section(
            "AOA profiles",
            "<p>One for each transmitter: dark where the power is high; a circle (or a dashed line of one azimuth) is "
            "the estimate, a cross the truth.</p>"
            + (_image(pictures.profiles(tiles), "profiles") if tiles else "<p>None.</p>"),
        ),
        _section("Bearings", _link_table(result.links)),
        _section("Rates", _recording_rates(result.links)),
        _section("What is wrong with the files", f"<ul>{problems}</ul>" if problems else "<p>Nothing.</p>"),
        _section("Scene", f"<pre>{html.escape(yaml.safe_dump(msgspec.to_builtins(scene), sort_keys=False))}</pre>"),
    ]
    facts = [("poses", str(result.kind)), ("links with a bearing", f"{len(estimated)} of {len(result.links)}")]
    return _page(f"Recording {scene.set_name} {scene.folder} {scene.stamp}", _summary(session, facts), sections)


def _recording_rates(links: Sequence[LinkResult]) -> str:
    heard = [(link.name, link.times) for link in links if link.times is not None and len(link.times.heard_s)]
    if not heard:
        return "<p>None: no packet has a time.</p>"
    return _image(pictures.recording_rates(heard), "packet and pairing rates of each transmitter")


def _flight_facts(content: FlightContent) -> list[tuple[str, str]]:
    errors = [error for error in pictures.error_degrees(content) if math.isfinite(error)]
    dropped = content.health[-1][1].get("recorder", {}).get("dropped", 0) if content.health else 0
    estimated = sum(one.estimate is not None for one in content.iterations)
    facts = [
        ("duration", f"{content.duration_s:.1f} s"),
        ("SAR iterations with an estimate", f"{estimated} of {len(content.iterations)}"),
        ("mean error", f"{sum(errors) / len(errors):.2f}° over {len(errors)}" if errors else "no truth in this log"),
        ("last state", content.states[-1][1] if content.states else "idle"),
        ("messages dropped while recording", str(dropped)),
    ]
    if content.left_out:
        facts.append(("left out", f"{content.left_out} messages of another time, of a clock that was not set"))
    return facts if content.is_whole else [*facts, ("file", "cut off: what stands before the cut is shown")]


def _profile_image(content: FlightContent) -> str:
    tiles = []
    for one in content.iterations:
        if one.estimate is None or one.number not in content.profiles:
            continue
        found = (one.estimate.azimuth_rad, one.estimate.polar_rad if one.estimate.polar_observable else None)
        title = f"{one.number}: {content.peer_name(one.peer)}, {one.estimate.packets} packets"
        tiles.append((title, content.profiles[one.number], found, content.true_bearing(one)))
    if not tiles:
        return "<p>None.</p>"
    every = math.ceil(len(tiles) / _MOST_TILES)
    few = f"<p>{len(tiles[::every])} of {len(tiles)}; the first section shows them all.</p>" if every > 1 else ""
    return few + _image(pictures.profiles(tiles[::every]), "AOA profiles of SAR iterations")


def _iteration_table(content: FlightContent) -> str:
    errors = iter(pictures.error_degrees(content))
    rows: list[list[Cell]] = []
    for one in content.iterations:
        estimate = one.estimate
        row: list[Cell] = [one.number, content.peer_name(one.peer), round(content.seconds(one.reference_ns), 1)]
        if estimate is None:
            rows.append([*row, one.received, None, None, None, None, None, None, None, one.refusal])
            continue
        truth = content.true_bearing(one)
        rows.append(
            [
                *row, estimate.packets, round(estimate.length_m, 2), _deg(estimate.azimuth_rad),
                elevation_deg(estimate.polar_rad) if estimate.polar_observable else None,
                _deg(truth[0]) if truth else None, _number(next(errors)), _deg(estimate.crb_rad, 3),
                round(estimate.reliability, 2), "",
            ]
        )  # fmt: skip
    head = ("#", "peer", "t [s]", "packets", "path [m]", "azimuth [°]", "elevation [°]", "true azimuth [°]",
            "error [°]", "CRB [°]", "reliability", "refused because")  # fmt: skip
    return _table(head, rows)


def _event_table(content: FlightContent) -> str:
    rows: list[list[Cell]] = [[f"{line.t_s:.2f}", line.kind, line.text] for line in content.events]
    return _table(("t [s]", "what", "text"), rows)


def _config(content: FlightContent) -> str:
    text = yaml.safe_dump(msgspec.to_builtins(content.config), sort_keys=False)
    return f"<pre>{html.escape(text)}</pre>"


def _link_table(links: Sequence[LinkResult]) -> str:
    rows: list[list[Cell]] = []
    for link in links:
        found = link.estimate
        azimuth = _deg(found.azimuth_rad) if found and found.azimuth_observable else None
        elevation = elevation_deg(found.polar_rad) if found and found.polar_observable else None
        rows.append(
            [
                link.name, azimuth, elevation, _deg(link.truth.azimuth_rad if link.truth else None),
                _deg(link.azimuth_error_rad), _deg(found.crb_rad, 3) if found else None,
                round(found.reliability, 2) if found else None, f"{link.used}/{link.packets}", link.problem or "",
            ]
        )  # fmt: skip
    head = ("transmitter", "azimuth [°]", "elevation [°]", "true azimuth [°]", "error [°]", "CRB [°]", "reliability",
            "packets", "problem")  # fmt: skip
    return _table(head, rows)


def _summary(session: Session, facts: Iterable[tuple[str, str]]) -> str:
    meta = session.metadata
    known = [("log", ", ".join(path.name for path in session.paths))]
    known += [(key, meta[key]) for key in ("role", "version", "session") if key in meta]
    rows: list[list[Cell]] = [[name, value] for name, value in (*known, *facts)]
    return _table(None, rows)


def _page(title: str, summary: str, sections: Iterable[str]) -> str:
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{html.escape(title)}</title>'
        f'<link rel="icon" href="data:,"><style>{_STYLE}</style></head>\n<body><h1>{html.escape(title)}</h1>\n'
        f"{summary}\n" + "\n".join(sections) + "\n</body></html>\n"
    )


def _words(text: str) -> str:
    return f"<p>{html.escape(text)}</p>" if text else ""


def _section(title: str, body: str) -> str:
    return f"<section><h2>{html.escape(title)}</h2>\n{body}</section>"


def _image(png: bytes, text: str) -> str:
    return f'<img alt="{html.escape(text)}" src="data:image/png;base64,{base64.b64encode(png).decode()}">'


def _table(head: Sequence[str] | None, rows: Iterable[Sequence[Cell]]) -> str:
    top = "" if head is None else "<tr>" + "".join(f"<th>{html.escape(name)}</th>" for name in head) + "</tr>"
    body = "".join("<tr>" + "".join(map(_cell, row)) + "</tr>\n" for row in rows)
    return f'<div class="scroll"><table>{top}\n{body}</table></div>'


def _cell(value: Cell) -> str:
    if value is None:
        return "<td>-</td>"
    is_text = isinstance(value, str) and not value.replace(".", "").replace("-", "").isdigit()
    return f'<td class="l">{html.escape(str(value))}</td>' if is_text else f"<td>{html.escape(str(value))}</td>"


def _found(link: LinkResult) -> tuple[float, float | None]:
    assert link.estimate is not None
    return link.estimate.azimuth_rad, link.estimate.polar_rad if link.estimate.polar_observable else None


def _truth(link: LinkResult) -> tuple[float, float] | None:
    return None if link.truth is None else (link.truth.azimuth_rad, link.truth.polar_rad)


def _deg(angle_rad: float | None, digits: int = 1) -> float | None:
    return None if angle_rad is None or not math.isfinite(angle_rad) else round(math.degrees(angle_rad), digits)


def _number(value: float) -> float | None:
    return round(value, 2) if math.isfinite(value) else None


def figures(content: FlightContent) -> dict[str, Any]:
    """The numbers of the page, for `--json`."""
    errors = [None if math.isnan(error) else error for error in pictures.error_degrees(content)]
    numbers = {"summary": summary_of(content), **dict(_flight_facts(content)), "errors_deg": errors}
    return json.loads(json.dumps(numbers))  # type: ignore[no-any-return]
