"""What a study leaves behind: JSON, pictures, and one HTML page with the pictures inside."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from companion.host.whole_file import write_whole
from companion.study.study import Finding, Outcome, Study, Value

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
table { border-collapse: collapse; margin: 1rem 0 } td, th { padding: .2rem .8rem; border-bottom: 1px solid #ddd }
td.n { text-align: right; font-variant-numeric: tabular-nums } img { max-width: 100% } .note { color: #555 }
"""


def shown(value: Value, unit: str) -> str:
    """Three significant digits with the unit; words as they are, nothing for None."""
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    if not math.isfinite(value):
        return "infinite"
    digits = f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return f"{digits}{'°' if unit == 'deg' else f' {unit}' if unit else ''}"


def shown_ours(finding: Finding) -> str:
    """With its interval, where there is one."""
    text = shown(finding.ours, finding.unit)
    return text if finding.interval is None else "{} ({:.3g}-{:.3g})".format(text, *finding.interval)


def write_json(path: Path, content: Outcome | Sequence[Outcome]) -> None:
    """One outcome as an object, those of `all` as a list."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=2))


def draw(path: Path, study: Study[Any, Any], outcome: Outcome) -> None:
    """Writes the study's picture as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=study.size_in, layout="constrained")
    FigureCanvasAgg(figure)
    study.draw(outcome.rows, figure)
    figure.suptitle(f"{outcome.title} (seed {outcome.seed}, {outcome.trials} trials)", fontsize=10)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


def write_page(
    path: Path, outcomes: Sequence[Outcome], pictures: Mapping[str, Path], missing: Mapping[str, str]
) -> None:
    """One file that needs no other: pictures are inside. `missing`: studies without a result, and why."""
    parts = ["<!doctype html><html lang='en'><meta charset='utf-8'><title>Studies</title>", f"<style>{_STYLE}</style>"]
    parts.append("<h1>Studies: ours beside the paper's</h1><ul>")
    parts += [f"<li><a href='#{o.study}'>{html.escape(o.study)}: {html.escape(o.title)}</a></li>" for o in outcomes]
    parts += [f"<li>{html.escape(name)} {html.escape(why)}</li>" for name, why in missing.items()]
    parts.append("</ul>")
    for outcome in outcomes:
        parts += _section(outcome, pictures.get(outcome.study))
    write_whole(path, "\n".join([*parts, "</html>"]))


def _section(outcome: Outcome, picture: Path | None) -> list[str]:
    labels = ", ".join(outcome.figures)
    head = f"seed {outcome.seed}, {outcome.trials} trials, {outcome.elapsed_s:.1f} s; the paper's {html.escape(labels)}"
    parts = [
        f"<h2 id='{outcome.study}'>{html.escape(outcome.study)}: {html.escape(outcome.title)}</h2>",
        f"<p>{head}</p>",
    ]
    parts.append("<table><tr><th>quantity</th><th>ours</th><th>paper</th></tr>")
    for finding in outcome.findings:
        texts = shown_ours(finding), shown(finding.paper, finding.unit)
        cells = "".join(f"<td class='n'>{html.escape(text)}</td>" for text in texts)
        parts.append(f"<tr><td>{html.escape(finding.quantity)}</td>{cells}</tr>")
    parts.append("</table>")
    parts += [f"<p class='note'>{html.escape(note)}</p>" for note in outcome.notes]
    if picture is not None:
        data = base64.b64encode(picture.read_bytes()).decode()
        parts.append(f"<img alt='{html.escape(outcome.title)}' src='data:image/png;base64,{data}'>")
    return parts
