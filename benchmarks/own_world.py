"""Is the tracker as sure as it should be? Worlds as it takes them to be: a target drawn from what is believed before
anything is heard, and bearings with the errors of its model, those that last all flight among them.

    python -m benchmarks.own_world [--worlds N] [--apertures N] [--particles N] [--range METRES] [--exact]
"""

from __future__ import annotations

import argparse
import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.guidance import tracker
from companion.guidance.regimes import REGIMES, Regime
from companion.guidance.tracker import TargetTracker
from companion.sensing.frame_turn import FrameTurn
from companion.sensing.records import Bearing
from companion.study.belief import PLACE_DEGREES, BeliefCheck, check
from companion.study.chi_square import middle_95
from wsr.geometry import direction

Floats = npt.NDArray[np.float64]

ANTENNA_M: Final = 0.5
_ANTENNA_STD_M: Final = 0.2
_TURN_STD_RAD: Final = math.radians(1.5)
_DRIFT: Final = 0.002
_OWN_STD_RAD: Final = 0.01
_CURVATURE_STD_PER_M: Final = (0.03, 0.12)
"""A bearing's own, from and to."""
_SHADOWING_DB, _KEPT = 4.0, 0.43
"""Deviation of what shadows received power, and what of it an aperture hands on: it is the same over 2.5 of them."""
_SPEED_M_S: Final = 0.5
_HEIGHT_M: Final = 1.5


class Flown(NamedTuple):
    """One report: the check of the whole belief, and its squared error along the level line of sight, across it and up
    (3,), each normalised by its own variance."""

    check: BeliefCheck
    parts: Floats


class Drawn(NamedTuple):
    """What is the same all flight."""

    room: Regime
    target_m: Floats
    heading_rad: float
    elevation_rad: float
    exponent: float


class OwnWorld:
    """`range_m` puts the target there and `constants` False makes all that is the same all flight what is expected of
    it, as a study does that asks for one distance; without them it is drawn."""

    def __init__(
        self, seed: int, *, room: int | None = None, range_m: float | None = None, constants: bool = True
    ) -> None:
        self._rng = rng = np.random.default_rng(seed)
        kind = REGIMES[rng.choice(len(REGIMES), p=[r.prior for r in REGIMES]) if room is None else room]
        drawn_m = float(ranges_m(rng, 1)[0])
        far_m, azimuth = drawn_m if range_m is None else range_m, rng.uniform(-math.pi, math.pi)
        height, heading, elevation, exponent = rng.normal(size=4) * (1.0 if constants else 0.0)
        self._same: Final = Drawn(
            room=kind,
            target_m=np.array(
                [far_m * math.cos(azimuth), far_m * math.sin(azimuth), ANTENNA_M + _ANTENNA_STD_M * float(height)]
            ),
            heading_rad=_TURN_STD_RAD * float(heading),
            elevation_rad=kind.elevation_std_rad * float(elevation),
            exponent=1.5 + 0.5 * float(exponent),
        )
        self._tracker = TargetTracker(None, _DRIFT, ANTENNA_M)
        self._here_m = np.array([0.0, 0.0, _HEIGHT_M])
        self._drifted_m = np.zeros(3)
        self._lines: list[Floats] = []
        self._shadow_db = _SHADOWING_DB * float(rng.normal())

    def fly(self, apertures: int, step_m: float = 0.4) -> list[Flown]:
        """Towards where the target is thought to be, ten degrees beside it, from near around it; a bearing of packets
        of its own at each step."""
        flown = []
        for count in range(apertures):
            bearing = self._bearing(round(count * step_m / _SPEED_M_S * 1e9))
            found = self._tracker.add(bearing, 0.0)
            x, y, z = (self._same.target_m + self._drifted_m).tolist()
            belief = check(found, bearing.target_p_enu_m, (x, y, z), bearing.p_local_enu_m)
            mean_m, covariance = np.array(found.whole.origin_local_enu_m), np.array(found.whole.covariance_m2)
            east, north = (mean_m - bearing.p_local_enu_m)[:2] / math.hypot(*(mean_m - bearing.p_local_enu_m)[:2])
            axes = np.array([[east, north, 0.0], [-north, east, 0.0], [0.0, 0.0, 1.0]])
            parts = (axes @ ((x, y, z) - mean_m)) ** 2 / np.diag(axes @ covariance @ axes.T)
            flown.append(Flown(belief, parts))
            self._step(found.azimuth_rad, found.range_m, math.tau * count * step_m / 1.2, step_m)
        return flown

    def _step(self, azimuth_rad: float, range_m: float, phase_rad: float, step_m: float) -> None:
        beside = math.pi / 2 if range_m < 1.3 else math.radians(10.0 if range_m > 3.5 else 28.0)
        c, s = math.cos(azimuth_rad + beside), math.sin(azimuth_rad + beside)
        weave_m = 0.3 * step_m * math.cos(phase_rad)
        self._here_m = self._here_m + np.array([0.9 * step_m * c - weave_m * s, 0.9 * step_m * s + weave_m * c, 0.0])
        self._here_m[2] = _HEIGHT_M + 0.1 * math.sin(phase_rad)
        std_m = math.hypot(_DRIFT * math.sqrt(5.0 * step_m), 0.02 * math.sqrt(step_m / _SPEED_M_S))
        self._drifted_m = self._drifted_m + self._rng.normal(0.0, std_m, 3)

    def _bearing(self, t_ns: int) -> Bearing:
        rng, same = self._rng, self._same
        room, offset_m = same.room, same.target_m - self._here_m
        apart_m = float(np.linalg.norm(offset_m))
        reliability = min(1.0, -room.reliability * math.log1p(rng.uniform() * math.expm1(-1.0 / room.reliability)))
        afar = min(1.0, max(0.0, (apart_m - 2.5) / 3.5))
        near, far, more = room.reported
        is_direct = rng.uniform() < min(near + (far - near) * afar + more * reliability, 0.99)
        azimuth, polar = self._direct(offset_m) if is_direct else self._elsewhere()
        unseen = room.unseen[1] + ((room.unseen[0] - room.unseen[1]) * (1.0 - afar) if is_direct else 0.0)
        own_std = 0.0 if rng.uniform() < unseen else rng.uniform(*_CURVATURE_STD_PER_M)
        per_m = self._curvature_per_m(apart_m if is_direct and rng.uniform() < room.trusted else None, own_std)
        x, y, z = (self._here_m + self._drifted_m).tolist()
        self._shadow_db = _KEPT * self._shadow_db + math.sqrt(1.0 - _KEPT**2) * _SHADOWING_DB * float(rng.normal())
        self._lines = [*self._lines, direction(azimuth, polar)][-20:]
        return Bearing(
            t_mono_ns=t_ns,
            p_local_enu_m=(x, y, z),
            azimuth_rad=azimuth,
            polar_rad=polar,
            azimuth_std_rad=_OWN_STD_RAD,
            polar_std_rad=_OWN_STD_RAD,
            target_p_enu_m=(0.0, 0.0, 0.0),
            target_boot=1,
            reliability=reliability,
            range_m=1.0 / per_m if own_std > 0.0 else None,
            range_std_m=own_std / per_m**2 if own_std > 0.0 else math.inf,
            turn=FrameTurn(0.0, _TURN_STD_RAD),
            power_dbm=-50.0 - 10.0 * same.exponent * math.log10(max(apart_m, 0.7)) + self._shadow_db,
        )

    def _curvature_per_m(self, apart_m: float | None, own_std: float) -> float:
        """One that shows: a range is told where it is known to half of itself. Of another source without `apart_m`."""
        std = math.hypot(0.09, 1.7 * _DRIFT, 3.0 * own_std)
        while True:
            per_m = self._rng.uniform(0.0, 2.0) if apart_m is None else 1.0 / apart_m + std * self._rng.normal()
            if per_m > max(2.0 * own_std, 1.0 / 60.0):
                return float(per_m)

    def _direct(self, offset_m: Floats) -> tuple[float, float]:
        """Azimuth and polar angle of the direct path, with what they are off by."""
        across, down = self._rng.normal(size=2)
        polar = math.atan2(math.hypot(offset_m[0], offset_m[1]), offset_m[2]) + self._same.elevation_rad
        polar += down * math.hypot(_OWN_STD_RAD, self._same.room.down_std_rad, _DRIFT)
        sine = max(math.sin(polar), 0.05)
        azimuth = math.atan2(offset_m[1], offset_m[0]) + self._same.heading_rad
        azimuth += across / sine * math.hypot(sine * _OWN_STD_RAD, self._same.room.across_std_rad, _DRIFT)
        return math.remainder(azimuth, math.tau), min(math.pi, abs(polar))

    def _elsewhere(self) -> tuple[float, float]:
        """Where earlier bearings pointed, or anywhere."""
        along = self._rng.normal(size=3)
        if self._lines and self._rng.uniform() < 0.8:
            along = self._lines[self._rng.integers(len(self._lines))] + math.radians(12.0) * along
        x, y, z = along / np.linalg.norm(along)
        return math.atan2(y, x), math.acos(z)


def ranges_m(rng: np.random.Generator, count: int) -> Floats:
    """(count,) of targets, as the tracker takes them to be before it has heard anything."""
    low, high = 0.5, 40.0
    logarithmic = np.exp(rng.uniform(math.log(low), math.log(high), count))
    return np.asarray(np.where(rng.uniform(size=count) < 0.7, rng.uniform(low, high, count), logarithmic))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.own_world", description=__doc__)
    parser.add_argument("--worlds", type=int, default=60)
    parser.add_argument("--apertures", type=int, default=30)
    parser.add_argument("--particles", type=int, help="in place of the tracker's own number")
    parser.add_argument("--range", type=float, help="of the target at first [m], in place of drawn ones")
    parser.add_argument("--exact", action="store_true", help="what is the same all flight is as expected")
    args = parser.parse_args()
    if args.particles is not None:
        tracker._PARTICLES = args.particles  # type: ignore[misc]
    worlds = [
        OwnWorld(seed, room=0, range_m=args.range, constants=not args.exact).fly(args.apertures)
        for seed in range(args.worlds)
    ]
    nees = np.array([[flown.check.nees for flown in world] for world in worlds])
    held = np.array([[flown.check[1:] for flown in world] for world in worlds]).mean(axis=(0, 1))
    parts = np.array([[flown.parts for flown in world] for world in worlds]).mean(axis=(0, 1))
    low, high = middle_95(PLACE_DEGREES * len(worlds)) / len(worlds)
    print(f"{len(worlds)} worlds of a kind room, {args.apertures} apertures")
    print(
        f"NEES: mean {nees.mean():.2f} (its band {low:.2f} to {high:.2f}), median {np.median(nees):.2f} (2.37 is right)"
    )
    print(f"90 % intervals hold: range {held[0]:.2f}, direction {held[1]:.2f}")
    print(f"parts along, across, up: {parts.round(2)} (1 each)")


if __name__ == "__main__":
    main()
