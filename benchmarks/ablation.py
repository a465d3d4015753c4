"""`python -m benchmarks.ablation DIR...`: what each step of `robust` is worth, the table of docs/results/ablation.md.

Every row is the default with one switch changed, over all links of data sets in the WSR layout and both trackers.
`--markdown` writes the table into docs/results/ablation.md, where it belongs.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

import click
import numpy as np

from benchmarks.document import ABLATION, replace_part
from benchmarks.recorded import Array, table, trials
from wsr.estimators.options import RobustOptions
from wsr.estimators.robust import Robust

DEFAULT = RobustOptions()
ROWS: Mapping[str, RobustOptions] = {
    "all steps": DEFAULT,
    "no jitter correction": replace(DEFAULT, jitter=False),
    "product, not one-way": replace(DEFAULT, one_way=False),
    "channel centre only": replace(DEFAULT, wideband=False),
    "product, centre only": replace(DEFAULT, one_way=False, wideband=False),
    "no reciprocity test": replace(DEFAULT, reciprocity=False),
    "packets of neither sign dropped": replace(DEFAULT, gate=True),
    "power as measured": replace(DEFAULT, unit_power=False),
    "weak packets raised too": replace(DEFAULT, weak_below=0.0),
    "no bins of the path": replace(DEFAULT, path_bins=False),
    "plane waves": replace(DEFAULT, focus=False),
    "whole aperture only": replace(DEFAULT, scales=(1,)),
    "scales 1, 2, 4": replace(DEFAULT, scales=(1, 2, 4)),
    "8 sub-apertures only": replace(DEFAULT, scales=(8,)),
    "broken chains in power": replace(DEFAULT, resign=False),
    "no weight for delay": replace(DEFAULT, delay_ns=None),
    "all subcarriers searched": replace(DEFAULT, power_share=1.0),
    "no linear phase": replace(DEFAULT, drift=False),
    "no last coherent step": replace(DEFAULT, coherent_above=2.0),
}
NOT_REDUCED = "transmitter's channels not reduced"
"""All steps, but the transmitter's 30 subcarriers, not the eight numbers that its datagrams carry."""


@click.command()
@click.argument("directories", metavar="DIR...", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True))
@click.option("--jobs", type=click.IntRange(min=1), default=lambda: os.cpu_count() or 1)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write every error here.")
@click.option("--markdown", is_flag=True, help="Write the table into docs/results/ablation.md.")
def main(directories: tuple[Path, ...], jobs: int, json_path: Path | None, markdown: bool) -> None:
    """Median / mean |azimuth error| [deg] and the share under 10 degrees [%] of every row."""
    done = trials(directories, [Robust(options) for options in ROWS.values()], jobs)
    raw = trials(directories, [Robust(DEFAULT)], jobs, as_sent=False)
    names = [*ROWS, NOT_REDUCED]
    errors, polar = np.vstack([done.errors_deg, raw.errors_deg]), np.vstack([done.polar_deg, raw.polar_deg])
    rows: list[tuple[str, Array, Array | None]] = list(zip(names, errors, polar, strict=True))
    lines = list(table(done.links, rows))
    click.echo("\n".join(lines))
    if json_path is not None:
        links = [asdict(link) for link in done.links]
        json_path.write_text(json.dumps({"links": links, "errors_deg": dict(zip(names, errors.tolist(), strict=True))}))
    if markdown:
        replace_part(ABLATION, "ablation", lines)


if __name__ == "__main__":
    main()
