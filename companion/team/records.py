"""What goes into the team's estimate and what comes out, without what computes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from companion.core.messages import Vector3


class RawSighting(NamedTuple):
    """One robot's bearing of another, on our clock, as that robot measured it. `number` is its own of the bearing."""

    observer: int
    target: int
    number: int
    t_ns: int
    azimuth_rad: float
    azimuth_std_rad: float
    polar_rad: float
    polar_std_rad: float
    """Infinite where the aperture did not tell it."""
    range_m: float | None
    range_std_m: float
    reliability: float
    fresh: float
    boot: int
    """Of the observer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """One robot relative to this one: place and covariance in this robot's own axes, from this robot's antenna;
    `heading_rad` by which its axes are turned against ours, counter-clockwise."""

    id: int
    p_own_m: Vector3
    covariance_m2: tuple[Vector3, Vector3, Vector3]
    std_m: float
    """Of its place, in the direction in which it is known worst."""
    heading_rad: float
    heading_std_rad: float
    placed: bool
    """Its place is known, not only a direction."""
    sightings: int
    """In the window, of it or by it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamState:
    """`own_heading_rad`: this robot's axes against East and North, by all robots' claims of them."""

    t_mono_ns: int
    own_heading_rad: float
    own_heading_std_rad: float
    members: tuple[Member, ...]
    sightings: int
    solve_s: float = 0.0
