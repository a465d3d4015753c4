"""Switches and numbers of the `robust` estimator; docs/estimation.md tells what each step is for and what it gave."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustOptions:
    """A switch or number for each step. A step whose data the aperture lacks is skipped."""

    jitter: bool = True
    """Take the turnaround jitter out, by the clocks of both cards."""
    one_way: bool = True
    """Work on the one-way channel, not on the product."""
    wideband: bool = True
    """Use all subcarriers, added in power; off: the channel centre."""
    path_bins: bool = True
    """Equal weight for equal length of path."""
    unit_power: bool = True
    """Every packet has the same power, so that fading does not shorten the aperture; off: as received."""
    weak_below: float = 0.5
    """Amplitudes below this share of the median's stay weak: their phase is mostly noise."""
    focus: bool = True
    """Spherical waves of an unknown range; off: flat ones."""
    delay_ns: float | None = 8.0
    """Decay of the weight for delays against the power centroid; None: no weight."""
    first_path: bool = True
    """Over bands of 30 MHz and more only what comes first is used; `wsr.first_path`."""
    scales: tuple[int, ...] = (1, 2, 4, 8)
    """Numbers of sub-apertures whose scores are averaged; the first is 1, the whole, the last the largest."""
    reciprocity: bool = True
    """Drop packets whose two ends disagree."""
    min_reciprocity: float = 0.8
    resign: bool = True
    """Join the pieces of a broken chain of signs as they add up; off: add them in power."""
    drift: bool = True
    """Look for a linear phase over time, of a constant velocity error, where the path is spatial; `wsr.drift`."""
    gate: bool = False
    """Drop packets that fit neither sign."""
    far_wavelengths: float = 1 / 3
    near_wavelengths: float = 1 / 12
    bin_wavelengths: float = 1 / 13.5
    ranges_m: tuple[float, ...] = (2.0, 3.5, 7.0, 30.0)
    near_ranges_m: tuple[float, ...] = (0.6, 1.0)
    """Searched too where the nearest of these fits best: waves of a source so near fit none of them. Believed where the
    aperture adds up coherently: echoes seem near, too."""
    step_rad: float = math.radians(2.0)
    planar_polars_rad: tuple[float, ...] = (math.radians(80.0), math.radians(66.0))
    """Circles searched over a level path. Phases go with the sine: none of 62 to 90 degrees is more than 4 % off."""
    min_planar_polar_rad: float = math.radians(60.0)
    refine_steps: int = 8
    coherent_above: float = 0.8
    power_share: float = 0.99
    """Share of the power over subcarriers that the search uses; 1: all of it."""
