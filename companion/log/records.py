"""Messages of a log as its readers need them. In JSON an infinite number is null."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from companion.core.messages import Vector3
from companion.log.truth import Truth
from wsr.geometry import angles, direction, great_circle


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedEstimate:
    """What readers need of an `AoaEstimate`."""

    azimuth_rad: float
    polar_rad: float
    reliability: float
    packets: int
    length_m: float
    azimuth_observable: bool = True
    polar_observable: bool = True
    azimuth_std_rad: float | None = None
    polar_std_rad: float | None = None
    crb_rad: float | None = None
    coherence: float = 0.0
    range_m: float | None = None
    extents_m: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedIteration:
    """What readers need of an `Iteration`."""

    number: int
    peer: int
    start_ns: int
    end_ns: int
    reference_ns: int
    received: int
    estimate: LoggedEstimate | None
    refusal: str
    p_local_enu_m: Vector3 | None = None
    compute_s: float = 0.0
    dropped: Mapping[str, int] = field(default_factory=dict)


class TruthTrack:
    """True positions over time, interpolated."""

    def __init__(self, truths: Iterable[Truth]) -> None:
        listed = sorted(truths, key=lambda truth: truth.t_mono_ns)
        self.t_ns = np.array([truth.t_mono_ns for truth in listed], np.int64)
        self.antenna_m = np.array([truth.antenna_enu_m for truth in listed]).reshape(-1, 3)
        names = {name for truth in listed for name in truth.peers_enu_m}
        self.peers_m = {
            name: np.array([truth.peers_enu_m.get(name, (np.nan,) * 3) for truth in listed]) for name in sorted(names)
        }

    def __bool__(self) -> bool:
        return len(self.t_ns) > 0

    def bearing(self, t_ns: int, peer: str) -> tuple[float, float] | None:
        """True azimuth and polar angle [rad] to a peer; None where the truth does not know."""
        if peer not in self.peers_m or not len(self.t_ns) or not self.t_ns[0] <= t_ns <= self.t_ns[-1]:
            return None
        own_m, peer_m = self.places_m(t_ns, peer)
        azimuth, polar = angles(peer_m - own_m)
        return (float(azimuth), float(polar)) if np.isfinite(azimuth) else None

    def error_deg(self, t_ns: int, peer: str, estimate: LoggedEstimate) -> float | None:
        """Great circle between an estimate and the truth, along the horizon where no polar angle is observable."""
        truth = self.bearing(t_ns, peer)
        if truth is None:
            return None
        if not estimate.polar_observable:
            return abs(math.degrees(math.remainder(estimate.azimuth_rad - truth[0], math.tau)))
        found = direction(estimate.azimuth_rad, estimate.polar_rad)
        return math.degrees(float(great_circle(found, direction(*truth))))

    def distance_m(self, t_ns: int, peer: str) -> float:
        own_m, peer_m = self.places_m(t_ns, peer)
        return float(np.linalg.norm(peer_m - own_m))

    def places_m(self, t_ns: int, peer: str) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Of our antenna and the peer's; ENU in the local frame."""
        return self._at(t_ns, self.antenna_m), self._at(t_ns, self.peers_m[peer])

    def _at(self, t_ns: int, p_m: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        start = self.t_ns[0]  # differences, so that nanoseconds of an uptime of weeks stay exact
        return np.array([np.interp(t_ns - start, self.t_ns - start, p_m[:, axis]) for axis in range(3)])
