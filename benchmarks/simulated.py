"""`python -m benchmarks.simulated`: estimators against truth and bound, as docs/results/simulated.md quotes them.

Each trial draws a path, a direction and noise from its own seed. The tests run the same campaigns with fewer trials.
`--markdown` writes the figures into docs/results/simulated.md.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import click
import numpy as np
import numpy.typing as npt

from benchmarks.document import SIMULATED, replace_part
from benchmarks.far_field import FarField
from benchmarks.scenes import WAVELENGTH_M
from wsr.aoa import AoaEstimate, Estimator
from wsr.aperture import Aperture, make_aperture
from wsr.channel import SPEED_OF_LIGHT_M_S, centre_channel
from wsr.estimators.bartlett import Bartlett
from wsr.estimators.options import RobustOptions
from wsr.estimators.robust import Robust
from wsr.geometry import angles, direction, great_circle
from wsr.ofdm import INDICES_5300_20MHZ, UNIT_HZ
from wsr.uncertainty import bound

Array = npt.NDArray[np.float64]

PACKETS = 600
DURATION_S = 7.0
LENGTH_M = 2.8
_ALL_STEPS = RobustOptions()


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """An aperture, the true source (3,) and the true path (M, 3), in the frame of the poses at their mean."""

    aperture: Aperture
    source_m: Array
    path_m: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundRow:
    """Mean square error over the bound of azimuth, polar angle and range together, phase unknown."""

    path: str
    snr_db: float
    subcarriers: int
    trials: int
    azimuth_ratio: float
    polar_ratio: float


@dataclass(frozen=True, slots=True)
class NearRow:
    """Sources at 10 m: median great-circle errors, and the share of trials with the range within 15 %."""

    trials: int
    far_field_deg: float
    robust_deg: float
    range_within_15: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseErrorRow:
    """Median and mean great-circle errors with wrong poses; `ate_m` is the root mean square of the positions' error."""

    kind: str
    trials: int
    ate_m: float
    bartlett_median_deg: float
    bartlett_mean_deg: float
    robust_median_deg: float
    robust_mean_deg: float


@dataclass(frozen=True, slots=True)
class StepRow:
    """What a step gives that recordings do not show: a figure of all steps, and of all but this one."""

    step: str
    figure: str
    trials: int
    with_it: float
    without_it: float


def helix_path(rng: np.random.Generator, length_m: float = LENGTH_M, packets: int = PACKETS) -> Array:
    """Two turns of a helix with a random axis."""
    turn = 4 * np.pi * np.linspace(0.0, 1.0, packets)
    p = np.stack([np.cos(turn), np.sin(turn), 0.25 * turn], axis=1)
    return _scaled(p @ np.linalg.qr(rng.normal(size=(3, 3)))[0].T, length_m)


def arbitrary_path(rng: np.random.Generator, length_m: float = LENGTH_M, packets: int = PACKETS) -> Array:
    """A smooth random path: three slow harmonics on each axis, drawn anew until it spans two wavelengths each way."""
    t = np.linspace(0.0, 1.0, packets)
    while True:
        phases = rng.uniform(0, 2 * np.pi, 3)
        waves = [np.sin(np.pi * n * t + phase) for n, phase in zip((1, 2, 3), phases, strict=True)]
        p = _scaled(np.stack(waves, axis=1) @ (rng.normal(size=(3, 3)) / np.array([[1.0], [1.5], [2.0]])), length_m)
        centred = p - p.mean(axis=0)
        if np.ptp(centred @ np.linalg.svd(centred, full_matrices=False)[2][2]) > 2 * WAVELENGTH_M:
            return p


PATHS: dict[str, Callable[[np.random.Generator], Array]] = {"helix": helix_path, "arbitrary": arbitrary_path}


def simulated(
    rng: np.random.Generator,
    path_m: Array,
    range_m: float,
    snr_db: float,
    *,
    wideband: bool = True,
    pose_error_m: Array | None = None,
    level: bool = False,
) -> Trial:
    """Channels of both directions over 30 subcarriers (or their product at the centre alone), each with `snr_db`, from
    exact distances; every packet has its own phase and detection delay. Poses err by `pose_error_m` (M, 3).
    `level`: a source at the path's own height."""
    u = direction(rng.uniform(-np.pi, np.pi), np.pi / 2 if level else math.acos(rng.uniform(-0.8, 0.8)))
    source = path_m.mean(axis=0) + range_m * u
    indices = INDICES_5300_20MHZ if wideband else np.zeros(1)
    frequency_hz = SPEED_OF_LIGHT_M_S / WAVELENGTH_M + UNIT_HZ * indices
    distance_m = np.linalg.norm(source - path_m, axis=1)
    channel = np.exp(-2j * np.pi * np.outer(distance_m, frequency_hz) / SPEED_OF_LIGHT_M_S)
    turn = np.exp(1j * rng.uniform(-np.pi, np.pi, (len(path_m), 1)))
    turn = turn * np.exp(-2j * np.pi * rng.uniform(0, 1e-7, (len(path_m), 1)) * UNIT_HZ * indices)
    noise = rng.normal(size=(4, *channel.shape)) * 10 ** (-snr_db / 20) / np.sqrt(2)
    forward = turn * (channel + noise[0] + 1j * noise[1])
    reverse = turn.conj() * (channel + noise[2] + 1j * noise[3])
    t_s = np.linspace(0.0, DURATION_S, len(path_m))
    p_m = path_m if pose_error_m is None else path_m + pose_error_m
    if not wideband:
        return Trial(make_aperture(t_s, p_m, (forward * reverse)[:, 0], WAVELENGTH_M), source, path_m)
    product = centre_channel(forward) * centre_channel(reverse)
    ahead, back = forward.astype(np.complex64), reverse.astype(np.complex64)
    return Trial(make_aperture(t_s, p_m, product, WAVELENGTH_M, forward=ahead, reverse=back), source, path_m)


def error_rad(trial: Trial, estimate: AoaEstimate) -> Array:
    """Errors (3,) of azimuth and polar angle and as a great circle, at the estimate's reference point along the true
    path."""
    u = _towards(trial, estimate)
    azimuth, polar = angles(u)
    apart = float(great_circle(direction(estimate.azimuth_rad, estimate.polar_rad), u))
    return np.array(
        [math.remainder(estimate.azimuth_rad - float(azimuth), math.tau), estimate.polar_rad - polar, apart]
    )


def bound_rows(trials: int, snrs_db: tuple[float, ...] = (10.0, 20.0, 30.0)) -> Iterator[BoundRow]:
    """Sources at 8 m, without pose errors."""
    for name in PATHS:
        for snr_db in snrs_db:
            for wideband in (True, False):
                ratios = [_over_bound(name, seed, snr_db, wideband) for seed in range(trials)]
                azimuth, polar = np.mean(ratios, axis=0)
                yield BoundRow(
                    path=name,
                    snr_db=snr_db,
                    subcarriers=30 if wideband else 1,
                    trials=trials,
                    azimuth_ratio=float(azimuth),
                    polar_ratio=float(polar),
                )


def near_row(trials: int) -> NearRow:
    """Arbitrary paths of 2.8 m, sources at 10 m, 20 dB."""
    far, near, close = [], [], []
    for seed in range(trials):
        rng = np.random.default_rng([2, seed])
        trial = simulated(rng, arbitrary_path(rng), 10.0, 20.0)
        estimate = Robust().estimate(trial.aperture)[0]
        true_range_m = float(np.linalg.norm(trial.source_m - np.array(estimate.reference_p_m)))
        close.append(estimate.range_m is not None and abs(estimate.range_m / true_range_m - 1) < 0.15)
        near.append(error_rad(trial, estimate)[2])
        far.append(error_rad(trial, FarField().estimate(trial.aperture)[0])[2])
    return NearRow(trials, _median_deg(far), _median_deg(near), float(np.mean(close)))


def pose_error_rows(trials: int, share: float = 0.07) -> Iterator[PoseErrorRow]:
    """Velocity bias of `share` of the path, and a random walk of the same absolute trajectory error; 10 m, 20 dB."""
    for kind in ("velocity bias", "random walk"):
        errors: dict[str, list[float]] = {"bartlett": [], "robust": []}
        ate_m = []
        for seed in range(trials):
            trial, wrong_m = _with_wrong_poses(kind, seed, share)
            ate_m.append(wrong_m)
            estimators: dict[str, Estimator] = {"bartlett": Bartlett(), "robust": Robust()}
            for name, estimator in estimators.items():
                errors[name].append(float(error_rad(trial, estimator.estimate(trial.aperture)[0])[2]))
        bartlett, robust = np.degrees(errors["bartlett"]), np.degrees(errors["robust"])
        yield PoseErrorRow(
            kind=kind,
            trials=trials,
            ate_m=float(np.mean(ate_m)),
            bartlett_median_deg=float(np.median(bartlett)),
            bartlett_mean_deg=float(bartlett.mean()),
            robust_median_deg=float(np.median(robust)),
            robust_mean_deg=float(robust.mean()),
        )


def step_rows(trials: int) -> Iterator[StepRow]:
    """The last coherent step, by the bound at 20 dB, and the linear phase, by a velocity bias."""
    both: list[float] = []
    for options in (_ALL_STEPS, RobustOptions(coherent_above=2.0)):
        ratios = [_over_bound(name, seed, 20.0, True, options=options) for name in PATHS for seed in range(trials)]
        both.append(float(np.mean(ratios)))
    yield StepRow("coherent refinement and most likely focus", "mean square error over the bound", 2 * trials, *both)
    both = []
    for options in (_ALL_STEPS, RobustOptions(drift=False)):
        errors = []
        for seed in range(trials):
            trial = _with_wrong_poses("velocity bias", seed, 0.07)[0]
            errors.append(float(error_rad(trial, Robust(options).estimate(trial.aperture)[0])[2]))
        both.append(_median_deg(errors))
    yield StepRow("linear phase", "median error [°] with a velocity bias of 7 %", trials, *both)


def _with_wrong_poses(kind: str, seed: int, share: float) -> tuple[Trial, float]:
    """A trial, and the root mean square error of its positions."""
    rng = np.random.default_rng([3, seed])
    path = PATHS["helix" if seed % 2 else "arbitrary"](rng)
    wrong = _bias(rng, share) if kind == "velocity bias" else _walk(rng, share)
    return simulated(rng, path, 10.0, 20.0, pose_error_m=wrong), _rms(wrong)


def _over_bound(name: str, seed: int, snr_db: float, wideband: bool, *, options: RobustOptions = _ALL_STEPS) -> Array:
    rng = np.random.default_rng([1, seed])
    trial = simulated(rng, PATHS[name](rng), 8.0, snr_db, wideband=wideband)
    estimate = Robust(options).estimate(trial.aperture)[0]
    to = trial.source_m - np.array(estimate.reference_p_m)
    azimuth, polar = (float(angle) for angle in angles(to))
    x = trial.aperture.chi_m - trial.aperture.chi_m.mean(axis=0)
    # Both ends measure the same phase, at every subcarrier: s^2 / (2 |h|^2) over 2 S.
    variance = 10 ** (-snr_db / 10) / (4 * (30 if wideband else 1))
    limit = variance * bound(x, WAVELENGTH_M, azimuth, polar, range_m=float(np.linalg.norm(to)), level=False)
    return np.asarray(error_rad(trial, estimate)[:2] ** 2 / np.diag(limit)[:2])


def _towards(trial: Trial, estimate: AoaEstimate) -> Array:
    """Unit vector from the reference point, moved from the poses' frame to the true path's, to the source."""
    offset_m = np.array(estimate.reference_p_m) - np.array(trial.aperture.reference_p_m)
    to = trial.source_m - (trial.path_m.mean(axis=0) + offset_m)
    return np.asarray(to / np.linalg.norm(to))


def _bias(rng: np.random.Generator, share: float, packets: int = PACKETS) -> Array:
    u = rng.normal(size=3)
    return np.asarray(np.linspace(0.0, 1.0, packets)[:, None] * (share * LENGTH_M / np.linalg.norm(u) * u))


def _walk(rng: np.random.Generator, share: float, packets: int = PACKETS) -> Array:
    walk = np.cumsum(rng.normal(size=(packets, 3)), axis=0)
    return np.asarray(walk * (_rms(_bias(rng, share, packets)) / _rms(walk)))


def _rms(wrong_m: Array) -> float:
    """Root mean square distance from the mean."""
    return float(np.sqrt(((wrong_m - wrong_m.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _scaled(p: Array, length_m: float) -> Array:
    return np.asarray(p * (length_m / np.linalg.norm(np.diff(p, axis=0), axis=1).sum()))


def _median_deg(errors_rad: list[float]) -> float:
    return math.degrees(float(np.median(errors_rad)))


def report(bounds: list[BoundRow], near: NearRow, poses: list[PoseErrorRow], steps: list[StepRow]) -> Iterator[str]:
    """Markdown."""
    yield f"Mean square error over the unknown-phase bound, {bounds[0].trials} trials each, sources at 8 m:"
    yield ""
    yield "| path | SNR [dB] | subcarriers | azimuth | polar angle |"
    yield "|---|---|---|---|---|"
    for row in bounds:
        ratios = f"{row.azimuth_ratio:.2f} | {row.polar_ratio:.2f}"
        yield f"| {row.path} | {row.snr_db:g} | {row.subcarriers} | {ratios} |"
    yield ""
    yield f"Sources at 10 m, arbitrary paths of {LENGTH_M:g} m, 20 dB:"
    yield ""
    yield "| trials | median error with plane waves [°] | with `robust` [°] | range within 15 % |"
    yield "|---|---|---|---|"
    yield f"| {near.trials} | {near.far_field_deg:.2f} | {near.robust_deg:.3f} | {near.range_within_15:.0%} |"
    yield ""
    yield "Wrong poses, 10 m, 20 dB (median / mean error [°]):"
    yield ""
    yield "| error | trials | ATE [m] | `bartlett` | `robust` | median against `bartlett`'s |"
    yield "|---|---|---|---|---|---|"
    for wrong in poses:
        yield (
            f"| {wrong.kind} | {wrong.trials} | {wrong.ate_m:.3f} | {wrong.bartlett_median_deg:.2f} / "
            f"{wrong.bartlett_mean_deg:.2f} | {wrong.robust_median_deg:.2f} / {wrong.robust_mean_deg:.2f} | "
            f"{wrong.robust_median_deg / wrong.bartlett_median_deg:.0%} |"
        )
    yield ""
    yield "Steps whose worth recordings over level paths do not show:"
    yield ""
    yield "| step | figure | trials | with it | without |"
    yield "|---|---|---|---|---|"
    for step in steps:
        yield f"| {step.step} | {step.figure} | {step.trials} | {step.with_it:.2f} | {step.without_it:.2f} |"


@click.command()
@click.option("--trials", type=click.IntRange(min=1), default=100, show_default=True)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the figures here.")
@click.option("--markdown", is_flag=True, help="Write the figures into docs/results/simulated.md.")
def main(trials: int, json_path: Path | None, markdown: bool) -> None:
    """Everything simulated that docs/results/simulated.md quotes."""
    stages = click.progressbar(length=4, label="simulating", file=sys.stderr)
    with stages:
        bounds = list(bound_rows(trials))
        stages.update(1)
        near = near_row(trials)
        stages.update(1)
        poses = list(pose_error_rows(trials))
        stages.update(1)
        steps = list(step_rows(trials))
        stages.update(1)
    lines = list(report(bounds, near, poses, steps))
    click.echo("\n".join(lines))
    if json_path is not None:
        figures = {
            "bound": [asdict(r) for r in bounds],
            "near": asdict(near),
            "pose_errors": [asdict(r) for r in poses],
            "steps": [asdict(r) for r in steps],
        }
        json_path.write_text(json.dumps(figures, indent=2) + "\n")
    if markdown:
        replace_part(SIMULATED, "simulated", lines)


if __name__ == "__main__":
    main()
