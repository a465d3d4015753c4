"""`python -m benchmarks.ablation DIR`: what each step of `robust` is worth, the table of docs/estimation.md.

Every row is the default with one switch changed, over all links of a data set in the WSR layout and both trackers.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import click
import numpy as np

from companion.analysis import Options
from companion.evaluation import LinkRow, evaluate_run, evaluation
from companion.recordings import find_runs
from companion.trajectories import PoseKind
from wsr.estimators.options import RobustOptions

DEFAULT = RobustOptions()
ROWS: Mapping[str, RobustOptions] = {
    "all steps": DEFAULT,
    "no jitter correction": replace(DEFAULT, jitter=False),
    "product, not one-way": replace(DEFAULT, one_way=False),
    "channel centre only": replace(DEFAULT, wideband=False),
    "product, centre only": replace(DEFAULT, one_way=False, wideband=False),
    "no weight for delay": replace(DEFAULT, delay_ns=None),
    "plane waves": replace(DEFAULT, focus=False),
    "whole aperture only": replace(DEFAULT, scales=(1,)),
    "8 sub-apertures only": replace(DEFAULT, scales=(8,)),
    "power as measured": replace(DEFAULT, unit_power=False),
    "no bins of the path": replace(DEFAULT, path_bins=False),
    "no reciprocity test": replace(DEFAULT, reciprocity=False),
    "broken chains in power": replace(DEFAULT, resign=False),
    "gate on phase steps": replace(DEFAULT, gate=True),
    "all subcarriers searched": replace(DEFAULT, power_share=1.0),
    "no linear phase": replace(DEFAULT, drift=False),
    "no last coherent step": replace(DEFAULT, coherent_above=2.0),
}
POSES = (PoseKind.MOCAP, PoseKind.T265)
_CUT_DEG = 30.0


def ablation(directory: Path, jobs: int) -> Iterator[tuple[str, dict[str, dict[str, float]]]]:
    """Name of each row and its figures by `set pose source` and `both`."""
    runs = find_runs(directory)
    with ProcessPoolExecutor(max_workers=jobs) as pool:
        for name, options in ROWS.items():
            figures: dict[str, dict[str, float]] = {}
            links: list[LinkRow] = []
            for kind in POSES:
                work = partial(evaluate_run, options=Options(kind=kind, robust=options))
                rows = [row for found, _ in pool.map(work, runs) for row in found]
                for set_name, set_figures in evaluation(rows, [], kind, name, 0.5).sets.items():
                    figures[f"{set_name} {kind}"] = asdict(set_figures)
                links += rows
            errors = np.array([row.error_deg for row in links])
            both = {
                "cut_mean_deg": float(np.minimum(errors, _CUT_DEG).mean()),
                "within_10": float((errors < 10).mean()),
            }
            yield name, {**figures, "both": both}


def _cell(figures: Mapping[str, float]) -> str:
    return f"{figures['median_deg']:.1f} / {figures['mean_deg']:.1f} / {100 * figures['within_10']:.0f}"


@click.command()
@click.argument("directory", type=click.Path(path_type=Path, exists=True))
@click.option("--jobs", type=click.IntRange(min=1), default=lambda: os.cpu_count() or 1)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the figures here.")
def main(directory: Path, jobs: int, json_path: Path | None) -> None:
    """Markdown: median / mean |azimuth error| in degrees and the share under 10 degrees, in percent."""
    table: dict[str, dict[str, dict[str, float]]] = {}
    for name, figures in ablation(directory, jobs):
        cells = [key for key in figures if key != "both" and not key.startswith("all ")]
        cells.sort()
        if not table:
            click.echo("| | " + " | ".join(cell.replace("_Set", "") for cell in cells) + " | cut mean | < 10° |")
            click.echo("|---" * (len(cells) + 3) + "|")
        texts = [_cell(figures[cell]) for cell in cells]
        both = figures["both"]
        click.echo(f"| {name} | {' | '.join(texts)} | {both['cut_mean_deg']:.2f} | {both['within_10']:.3f} |")
        table[name] = figures
    if json_path is not None:
        json_path.write_text(json.dumps(table, indent=2) + "\n")


if __name__ == "__main__":
    main()
