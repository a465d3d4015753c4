"""`crb`: the bound over 64800 directions for a helix, a circle and a line of equal length (label fig:cr-theta-phi)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from companion.study.figures import draw_cdf
from companion.study.paths import Array, circle, line, spherical_helix
from companion.study.study import Finding, Settings, Study, Summary
from wsr.channel import wavelength_m
from wsr.crb import Phase
from wsr.crb.sphere import crb_over, scatter_factor

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LENGTH_M = 3.14
_PACKETS = 400
_PHASE_VARIANCE_RAD2 = 0.01
_WAVELENGTH_M = wavelength_m(108)
_QUANTILES = np.linspace(0.0, 1.0, 201)
_PATHS: dict[str, Callable[[float, int], Array]] = {"helix": spherical_helix, "circle": circle, "line": line}
_AZIMUTH, _POLAR = (np.radians(a.ravel()) for a in np.meshgrid(np.arange(1, 361), np.arange(1, 181)))


@dataclass(frozen=True, slots=True)
class GeometryCase:
    """One path and whether the phase at its start is known. One-way, as the paper has it."""

    geometry: str
    phase: Phase


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundCurves:
    """Roots of the bounds in degrees at 201 quantiles over the directions [1, 360] x [1, 180] degrees.

    `theta` and `phi` are of the inverse of the 2 x 2 information, `theta_alone` and `phi_alone` 1/A and 1/B;
    `great_circle` counts directions by their solid angle.
    """

    geometry: str
    phase: str
    theta_deg: list[float]
    phi_deg: list[float]
    theta_alone_deg: list[float]
    phi_alone_deg: list[float]
    great_circle_deg: list[float]
    infinite_share: float
    """Of directions in which at least one of both angles has no bound."""

    def at(self, name: str, share: float) -> float:
        """The quantile of one of the lists."""
        values: list[float] = getattr(self, f"{name}_deg")
        return values[round(share * (len(values) - 1))]


def _plan(settings: Settings) -> list[GeometryCase]:
    return [GeometryCase(geometry, phase) for phase in ("known", "unknown") for geometry in _PATHS]


def _trial(case: GeometryCase, seed: SeedSequence) -> BoundCurves:
    """Nothing is random here: one pass over all directions."""
    chi = _PATHS[case.geometry](_LENGTH_M, _PACKETS)
    if case.geometry != "line":
        # The paper counts these from the centre of their sphere or circle.
        chi = chi - (0.0 if case.geometry == "helix" else chi[:-1].mean(axis=0))
    factor = scatter_factor(chi, _WAVELENGTH_M, _PHASE_VARIANCE_RAD2, case.phase, round_trip=False)
    field = crb_over(factor, _AZIMUTH, _POLAR)
    order = np.argsort(field.great_circle_rad2)
    solid = np.cumsum(np.sin(_POLAR)[order])
    at = np.minimum(np.searchsorted(solid, _QUANTILES * solid[-1]), order.size - 1)
    unbounded = np.isinf(field.azimuth_rad2) | np.isinf(field.polar_rad2)
    return BoundCurves(
        geometry=case.geometry,
        phase=case.phase,
        theta_deg=_quantiles_deg(field.polar_rad2),
        phi_deg=_quantiles_deg(field.azimuth_rad2),
        theta_alone_deg=_quantiles_deg(field.polar_alone_rad2),
        phi_alone_deg=_quantiles_deg(field.azimuth_alone_rad2),
        great_circle_deg=np.degrees(np.sqrt(field.great_circle_rad2[order[at]])).tolist(),
        infinite_share=float(np.mean(unbounded)),
    )


def _quantiles_deg(variance_rad2: np.ndarray) -> list[float]:
    values = np.sort(variance_rad2)
    at = np.round(_QUANTILES * (values.size - 1)).astype(int)
    return [float(v) for v in np.degrees(np.sqrt(values[at]))]


def _summarise(rows: Sequence[BoundCurves]) -> Summary:
    findings = []
    for row in rows:
        for name in ("theta", "phi"):
            for share, word in ((0.5, "median"), (0.9, "90th percentile")):
                quantity = f"{row.geometry}, phase {row.phase}: {word} of sqrt CRB_{name}"
                findings.append(Finding(quantity=quantity, ours=row.at(name, share), paper=None, unit="deg"))
        if row.geometry == "line":
            for letter, name in (("A", "theta"), ("B", "phi")):
                quantity = f"line, phase {row.phase}: median of sqrt 1/{letter} alone"
                findings.append(Finding(quantity=quantity, ours=row.at(f"{name}_alone", 0.5), paper=None, unit="deg"))
            quantity = f"line, phase {row.phase}: directions without a joint bound"
            findings.append(
                Finding(quantity=quantity, ours=100 * row.infinite_share, paper="inflates to infinity", unit="%")
            )
    for phase in ("known", "unknown"):
        for name in ("theta", "phi"):
            for share, word in ((0.5, "median"), (0.9, "90th percentile")):
                findings.append(
                    Finding(
                        quantity=f"order by CRB_{name}, phase {phase}, {word}",
                        ours=_order(rows, phase, name, share),
                        paper=_PAPER_ORDER,
                    )
                )
    return Summary(
        findings,
        [
            f"{_LENGTH_M} m of path, {_PACKETS} packets, one-way phase with variance {_PHASE_VARIANCE_RAD2} rad^2, "
            "channel 108; equal length, so the helix has 0.82 of the circle's radius.",
            "The paper gives an order and no numbers. Where ours differs, docs/results/studies.md says why.",
        ],
    )


_PAPER_ORDER = "helix < circle < line"


def _order(rows: Sequence[BoundCurves], phase: str, name: str, share: float) -> str:
    values = sorted((row.at(name, share), row.geometry) for row in rows if row.phase == phase)
    return " < ".join(geometry for _, geometry in values)


def _draw(rows: Sequence[BoundCurves], figure: Figure) -> None:
    axes = figure.subplots(2, 2)
    for column, phase in enumerate(("known", "unknown")):
        chosen = [row for row in rows if row.phase == phase]
        for line_number, name in enumerate(("phi", "theta")):
            groups = {row.geometry: getattr(row, f"{name}_deg") for row in chosen}
            flat = next(row for row in chosen if row.geometry == "line")
            letter = "B" if name == "phi" else "A"
            groups[f"line, 1/{letter} alone"] = getattr(flat, f"{name}_alone_deg")
            panel = axes[line_number, column]
            draw_cdf(panel, groups, rf"$\sqrt{{\mathrm{{CRB}}_\{name}}}$ [deg], phase {phase}", None)
            panel.set_xscale("log")
            panel.set_xlim(0.005, 5)


STUDY = Study(
    name="crb",
    title="Cramer-Rao bound for simulated robot motion",
    figures=("fig:cr-theta-phi",),
    default_trials=1,
    plan=_plan,
    trial=_trial,
    summarise=_summarise,
    draw=_draw,
    size_in=(10.0, 7.5),
)
