"""`python -m benchmarks.crossvalidation DIR...`: are the numbers of `robust` chosen, or tuned to these runs?

Every choice of a grid around the default is tried on every link, with motion capture and with the T265. Then each
position in turn is held out, or each run, or each transmitter: the choice with the least mean error of the others is
judged by its errors on those held out. The held-out errors together, cell by cell (a set and a source of poses), are
what choosing by these runs is worth on a place never seen; beside them stands each fixed choice over all links.

A bootstrap over places and transmitters, since links of one place and transmitter err alike, says how well the figures
of the default are known at all. `--markdown` writes what docs/results/crossvalidation.md quotes.
"""

from __future__ import annotations

import itertools
import json
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import click
import numpy as np

from benchmarks.document import CROSS_VALIDATION, replace_part
from benchmarks.recorded import Array, RecordedLink, Trials, cells, figures_of, missed, table, trials
from wsr.estimators.options import RobustOptions
from wsr.estimators.robust import Robust

DELAYS_NS: Sequence[float | None] = (5.0, 6.0, 7.0, 8.0, 10.0, 12.0)
SCALES: Sequence[tuple[int, ...]] = ((1, 2, 4), (1, 2, 4, 8), (1, 2, 4, 8, 16))
BINS_WAVELENGTHS: Sequence[float] = (1 / 20, 1 / 13.5, 1 / 9)
_BOOTSTRAPS = 2000
DEFAULT = RobustOptions()


@dataclass(frozen=True, slots=True)
class Choice:
    """One point of the grid."""

    delay_ns: float | None
    scales: tuple[int, ...]
    bin_wavelengths: float

    @property
    def estimator(self) -> Robust:
        return Robust(
            replace(DEFAULT, delay_ns=self.delay_ns, scales=self.scales, bin_wavelengths=self.bin_wavelengths)
        )

    def __str__(self) -> str:
        delay = "no delay" if self.delay_ns is None else f"{self.delay_ns:g} ns"
        return f"{delay}, scales {'-'.join(map(str, self.scales))}, bins λ/{1 / self.bin_wavelengths:g}"


OWN = Choice(DEFAULT.delay_ns, DEFAULT.scales, DEFAULT.bin_wavelengths)


HELD_OUT: Mapping[str, Callable[[RecordedLink], str]] = {
    "position": lambda link: link.place,
    "run": lambda link: link.run,
    "transmitter": lambda link: link.tx,
}


@dataclass(frozen=True, slots=True)
class Fold:
    """What was chosen without `held_out`, and its mean error there."""

    held_out: str
    chosen: Choice
    held_out_mean_deg: float


def grid() -> list[Choice]:
    """Every combination; the default is one of them."""
    choices = [Choice(*each) for each in itertools.product(DELAYS_NS, SCALES, BINS_WAVELENGTHS)]
    return choices if OWN in choices else [OWN, *choices]


def folds(
    done: Trials, choices: Sequence[Choice], key: Callable[[RecordedLink], str], cut_deg: float
) -> tuple[list[Fold], Array]:
    """Each value of `key` held out in turn, and the held-out errors (links,) of all of them together. In the choice
    errors count up to `cut_deg`. Raises ValueError where `key` has one value only."""
    keys = np.array([key(link) for link in done.links])
    if len(set(keys)) < 2:
        raise ValueError(f"all links are of {keys[0]}")
    counted = np.minimum(done.errors_deg, cut_deg)
    held_out = np.zeros(len(keys))
    found = []
    for value in sorted(set(keys)):
        here = keys == value
        best = int(np.argmin(counted[:, ~here].mean(axis=1)))
        held_out[here] = done.errors_deg[best, here]
        found.append(Fold(str(value), choices[best], float(held_out[here].mean())))
    return found, held_out


def bootstrap(links: Sequence[RecordedLink], errors_deg: Array, seed: int = 1) -> dict[str, tuple[Array, Array]]:
    """5th and 95th percentiles (3,) of each cell's figures over draws of its pairs of place and transmitter."""
    rng = np.random.default_rng(seed)
    result = {}
    for cell in sorted({link.cell for link in links}):
        clusters: dict[tuple[str, str], list[float]] = {}
        for link, error in zip(links, errors_deg, strict=True):
            if link.cell == cell:
                clusters.setdefault((link.place, link.tx), []).append(float(error))
        groups = [np.array(group) for group in clusters.values()]
        drawn = rng.integers(0, len(groups), (_BOOTSTRAPS, len(groups)))
        figures = np.array([figures_of(np.concatenate([groups[n] for n in draw])) for draw in drawn])
        low, high = np.percentile(figures, [5, 95], axis=0)
        result[cell] = (low, high)
    return result


def rows(done: Trials, choices: Sequence[Choice], cut_deg: float) -> list[tuple[str, Array, Array | None]]:
    """Of the table: held out, and every choice, the default's in bold."""
    result: list[tuple[str, Array, Array | None]] = []
    for what, key in _several(done.links):
        result.append((f"each {what} held out", folds(done, choices, key, cut_deg)[1], None))
    for n, choice in enumerate(choices):
        name = f"**{choice}**" if choice == OWN else str(choice)
        result.append((name, done.errors_deg[n], done.polar_deg[n]))
    return result


def notes(done: Trials, choices: Sequence[Choice], cut_deg: float) -> Iterator[str]:
    """What was chosen in each fold, which choices miss a cell, and how well the figures of the default are known."""
    for what, key in _several(done.links):
        found = folds(done, choices, key, cut_deg)[0]
        chosen = Counter(str(fold.chosen) for fold in found)
        counts = "; ".join(f"{choice} in {count}" for choice, count in chosen.most_common())
        worst = max(found, key=lambda fold: fold.held_out_mean_deg)
        yield (
            f"- Each of {len(found)} {what}s held out: chosen {counts}; worst {worst.held_out}, "
            f"{worst.held_out_mean_deg:.2f}° in the mean."
        )
    misses = [(choice, missed(cells(done.links, done.errors_deg[n]))) for n, choice in enumerate(choices)]
    yield f"- {sum(not missing for _, missing in misses)} of {len(choices)} choices are nowhere worse than the toolbox."
    for choice, missing in misses:
        if missing:
            yield f"- {choice} misses {', '.join(f'{cell}: {what}' for cell, what in missing)}."
    for cell, (low, high) in bootstrap(done.links, done.errors_deg[choices.index(OWN)]).items():
        yield (
            f"- {cell}, default, 90 % of draws: median {low[0]:.1f}-{high[0]:.1f}°, mean {low[1]:.1f}-{high[1]:.1f}°, "
            f"under 10° {100 * low[2]:.0f}-{100 * high[2]:.0f} %."
        )


def _several(links: Sequence[RecordedLink]) -> Iterator[tuple[str, Callable[[RecordedLink], str]]]:
    """What can be held out: of which there is more than one."""
    return ((what, key) for what, key in HELD_OUT.items() if len({key(link) for link in links}) > 1)


@click.command()
@click.argument("directories", metavar="DIR...", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True))
@click.option("--jobs", type=click.IntRange(min=1), default=lambda: os.cpu_count() or 1)
@click.option(
    "--cut",
    type=click.FloatRange(min=1.0),
    default=180.0,
    show_default=True,
    help="In the choice errors count up to this [deg].",
)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write every error here.")
@click.option("--markdown", is_flag=True, help="Write the result into docs/results/crossvalidation.md.")
def main(directories: tuple[Path, ...], jobs: int, cut: float, json_path: Path | None, markdown: bool) -> None:
    """Median / mean |azimuth error| [deg] and the share under 10 degrees [%], of every choice and held out."""
    choices = grid()
    done = trials(directories, [choice.estimator for choice in choices], jobs)
    lines = [*table(done.links, rows(done, choices, cut)), "", *notes(done, choices, cut)]
    click.echo("\n".join(lines))
    if json_path is not None:
        errors = {str(choice): done.errors_deg[n].tolist() for n, choice in enumerate(choices)}
        json_path.write_text(json.dumps({"links": [asdict(link) for link in done.links], "errors_deg": errors}))
    if markdown:
        replace_part(CROSS_VALIDATION, "cross-validation", lines)


if __name__ == "__main__":
    main()
