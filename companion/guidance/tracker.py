"""Bearings from several places -> where the target is, which other places may be it, and how sure that is.

A particle filter over places of the target: everything an aperture saw counts, and places that explain it live on side
by side until motion decides. The target may drive: it shares its own poses, so what is unknown, and the same for all
bearings, is the origin of its frame in ours. Taken for standing, a target that drives across the line of sight would
seem nearer than it is. The model is in docs/guidance.md.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.core.messages import Vector3
from companion.guidance.antenna_height import AntennaHeight
from companion.guidance.crossings import Crossings
from companion.guidance.likelihood import elsewhere, likelihoods
from companion.guidance.loudness import Loudness
from companion.guidance.modes import normalised, systematic
from companion.guidance.regimes import REGIMES, changed, drawn_elevation, of_bearing, of_power, prior_share
from companion.guidance.target import Scatter, Target, of_places
from companion.guidance.target_axes import AXES_STD_RAD, bend_rad, carried_m, drawn_axes, jumped_m
from companion.guidance.twins import parted
from companion.guidance.witnesses import Witnesses
from companion.sensing.frame_turn import DRIFT, DRIFT_ALIKE_M
from companion.sensing.records import Bearing
from wsr.geometry import direction

_Floats = npt.NDArray[np.float64]
_Bools = npt.NDArray[np.bool_]
_PARTICLES: Final = 1500
_AT_FIRST, _LEFT = 6, 0.6
"""So many times as many at first, and so many of them after each drawing, down to the number above: few of all ranges,
rooms and constants agree with the first bearings, and later ones choose from what those leave."""
_RESAMPLE_BELOW: Final = 0.5
_BORN: Final = 0.015
"""Of the particles, at each bearing: new ones where it points, so that no source is lost for good."""
_MOVED, _MOVED_BY = 0.06, 0.5
"""And so many at the places of likely ones, but nearer or farther by up to such a ratio: ranges that were off in the
same way for a while, as those of echoes are, leave none at the right one."""
_GROWN: Final = 3.0
"""For so many apertures they do not die for others, however light: where images are what is seen, a place takes some to
show that it is the right one."""
_NEWBORN: Final = 0.3
"""How likely they are, of the average particle, if that many had been drawn anywhere."""
_ANYWHERE: Final = 0.2
"""Of the first particles: in any direction, since what is seen first may be an image."""
_REACH_M: Final = (0.5, 40.0)
"""Targets are looked for within: radio does not reach much farther indoors."""
_SPREAD_RAD: Final = math.radians(7.0)
_TWIN_RAD: Final = math.radians(0.4)
_WALK_M_SQRT_S: Final = 0.05
"""By which the target's place in the local frame walks in a second, beside drift: an autopilot's estimate wanders by
0.2 to 0.3 m in half a minute."""
_SPREAD_EVENLY: Final = 0.7
"""Of new particles: at any range alike. The others are spread by ratios, so that near places are not forgotten."""
_CROSSING: Final = 0.6
"""Of new particles: where the new bearing crosses one before."""
_BEYOND, _EXCLUDED = math.log(10.0), 20.0
"""Off the logarithm of a weight beyond the fence: who flies to a robot expects it where that can be, ten to one; and on
condition that it is there. Where all places are beyond, neither says anything."""
_WITNESS_M, _WITNESS_STD_M = 3.5, 0.6
"""A source was seen at a place by a range up to the one, known to the other."""


class TargetTracker:
    """Takes bearings of one target. The same bearings give the same target."""

    def __init__(
        self,
        reach: Callable[[_Floats], _Bools] | None = None,
        drift: float = DRIFT,
        antenna_height_m: float | None = None,
    ) -> None:
        """`reach` says of places (N, 3) in the local frame whether a target can be flown to there: elsewhere it is ten
        times less likely; `drift` by which share of the way of both robots their poses part from the truth;
        `antenna_height_m` how high above the ground the target's antenna is, where it stands on it."""
        self._reach = reach
        self._against = _BEYOND
        self._heights = AntennaHeight(antenna_height_m)
        self._drift = drift
        self._rng = np.random.default_rng(_PARTICLES)
        self._axes_rng = np.random.default_rng([_PARTICLES, 1])  # of a target that stands they change nothing
        self._origins_m = np.zeros((0, 3))
        self._log_weight, self._heading_rad, self._elevation_rad, self._axes_rad = np.zeros((4, 0))
        self._share = np.zeros((0, 0))
        """(K, N) probability of each kind of room, if the target is at a particle."""
        self._lines = Crossings()
        self._loudness = Loudness()
        self._told: _Floats = np.zeros(0)
        """What received powers have already said of each particle,"""
        self._stood: _Floats = np.zeros(0)
        """its height,"""
        self._fenced: _Floats = np.zeros(0)
        """and the fence."""
        self._age: _Floats = np.zeros(0)
        """Apertures since each was drawn; infinite of the first."""
        self._newest: Bearing | None = None
        self._target: Target | None = None
        self._witnesses: Witnesses | None = None

    def add(self, bearing: Bearing, ground_m: float = -math.inf) -> Target:
        """Takes the newest bearing, and says what all of them say."""
        self.take(bearing, ground_m)
        return self.target()

    def take(self, bearing: Bearing, ground_m: float = -math.inf) -> None:
        """Takes the newest bearing; the ground is at `ground_m` (Up) of the local frame. One of another boot of the
        target has another origin: all before is forgotten."""
        if self._newest is None or self._newest.target_boot != bearing.target_boot:
            self._witnesses = Witnesses(_place(bearing))
            self._heights.begin_anew()
            self._lines.clear()
            self._loudness = Loudness()
            self._loudness.add(_place(bearing), bearing.power_dbm, 1.0)
            count = round(_AT_FIRST * _PARTICLES)
            self._told, self._age = np.zeros(count), np.full(count, math.inf)
            self._origins_m = np.zeros((count, 3))
            self._log_weight, self._heading_rad, self._elevation_rad, self._axes_rad = np.zeros((4, count))
            self._share = np.zeros((len(REGIMES), count))
            density = self._draw(bearing, ground_m, np.arange(count), _ANYWHERE)
            self._share = prior_share(self._elevation_rad)
            self._stood = self._heights.log_prior(self._height_m(self._origins_m, bearing, ground_m))
            self._fenced = self._log_reach(self._origins_m, bearing)
            drawn = self._fenced if self._heights.is_expected else self._fenced + self._stood
            self._log_weight = normalised(drawn - np.log(density))
            self._weigh(bearing, ground_m, self._drift)
        else:
            before = self._after_jump(self._newest, bearing)
            bend = bend_rad(before, bearing)
            self._wander(before, bearing)
            self._turn(before, bearing)
            self._bear(bearing, ground_m)
            self._weigh(bearing, ground_m, math.hypot(self._drift, bend))
            self._listen(bearing)
        self._newest = bearing
        self._lines.add(_place(bearing), direction(bearing.azimuth_rad, bearing.polar_rad))
        self._note(bearing)
        self._resample()
        self._target = None

    def rooms(self) -> _Floats:
        """(K,) probability of each of the kinds of room."""
        return np.asarray(self._share @ np.exp(self._log_weight))

    def shift(self, delta_enu_m: Vector3) -> None:
        """The autopilot's local frame was set anew: all places in it are `delta_enu_m` elsewhere."""
        self._shift_origins(np.array(delta_enu_m))
        if self._newest is not None:
            x, y, z = (p + d for p, d in zip(self._newest.p_local_enu_m, delta_enu_m, strict=True))
            self._newest = replace(self._newest, p_local_enu_m=(x, y, z))
            self._target = None

    def _shift_origins(self, delta_m: _Floats) -> None:
        """All that is kept in places relative to the target's own motion is `delta_m` elsewhere."""
        self._origins_m = self._origins_m + delta_m
        self._lines.shift(delta_m)
        self._loudness.shift(delta_m)
        if self._witnesses is not None:
            self._witnesses.shift(delta_m)

    def _after_jump(self, before: Bearing, bearing: Bearing) -> Bearing:
        """The bearing before as the target's poses of now would have it, after a jump of them."""
        jump_m = jumped_m(before, bearing)
        if not jump_m.any():
            return before
        self._shift_origins(-jump_m)
        x, y, z = np.add(before.target_p_enu_m, jump_m).tolist()
        return replace(before, target_p_enu_m=(x, y, z))

    def nearer_source(self) -> Vector3 | None:
        """Another source than the likeliest, as the origin of the target's frame, that was seen nearer to where the
        flight began: then what is likeliest is a mirror image."""
        assert self._witnesses is not None
        return self._witnesses.nearer(np.array(self.target().origin_local_enu_m))

    def within(self, p_local_enu_m: Vector3, target_p_enu_m: Vector3, range_m: float) -> float:
        """Probability that the target, whose own poses say `target_p_enu_m`, is within a range of a place."""
        assert self._newest is not None
        since_m = np.subtract(target_p_enu_m, self._newest.target_p_enu_m)
        apart_m = self._origins_m + carried_m(self._axes_rad, since_m) + np.subtract(target_p_enu_m, p_local_enu_m)
        near = np.einsum("nx,nx->n", apart_m, apart_m) < range_m**2
        return float(np.exp(self._log_weight[near]).sum())

    def scatter(self, count: int) -> Scatter:
        """A systematic sample of so many places."""
        assert self._newest is not None
        weight = np.exp(self._log_weight)
        at = systematic(weight / weight.sum(), count)
        places_m = self._origins_m[at] + np.array(self._newest.target_p_enu_m)
        return Scatter(places_m, self._heading_rad[at], self._elevation_rad[at], self.rooms())

    def on_condition(self) -> TargetTracker:
        """The same belief, from its next bearing on on condition that the target is within reach."""
        other = copy.deepcopy(self)
        other._against = _EXCLUDED
        return other

    def target(self) -> Target:
        """What all bearings together say, worked out when it is first asked for. Raises AssertionError before the
        first."""
        if self._target is None:
            assert self._newest is not None
            self._target = of_places(self._origins_m, np.exp(self._log_weight), self._newest)
        return self._target

    def _note(self, bearing: Bearing) -> None:
        """A source whose range shows where it is."""
        assert self._witnesses is not None
        self._witnesses.look(_place(bearing), bearing.fresh)
        if bearing.range_m is None or bearing.range_m > _WITNESS_M or bearing.range_std_m > _WITNESS_STD_M:
            return
        unit = direction(bearing.azimuth_rad, bearing.polar_rad)
        self._witnesses.add(_place(bearing) + bearing.range_m * unit, unit, bearing.fresh)

    def _draw(self, bearing: Bearing, ground_m: float, which: npt.NDArray[np.intp], anywhere: float) -> _Floats:
        """Draws the particles `which` (M,) anew: where a bearing and the other paths of its aperture point, and by
        chance elsewhere, at all ranges. Returns how many times as dense (M,) they are as if all directions were alike;
        all azimuths where a height is expected, at which they are then, whatever bearings say of it."""
        count = len(which)
        paths = [(bearing.azimuth_rad, bearing.polar_rad, 1.0)]
        paths += [(p.azimuth_rad, p.polar_rad, 0.5 * min(1.0, p.relative_power)) for p in bearing.others]
        at, down, share = (np.array([path[k] for path in paths])[:, None] for k in (0, 1, 2))
        share = (1.0 - anywhere) * share / share.sum()
        chosen = self._rng.choice(len(paths) + 1, count, p=[*share[:, 0], anywhere])
        lost, chosen = chosen == len(paths), np.minimum(chosen, len(paths) - 1)
        azimuth = at[chosen, 0] + self._rng.normal(0.0, _SPREAD_RAD, count)
        polar = np.abs(down[chosen, 0] + self._rng.normal(0.0, _SPREAD_RAD, count))
        upright = np.arccos(self._rng.uniform(-1.0, 1.0, count))
        azimuth = np.where(lost, self._rng.uniform(-math.pi, math.pi, count), azimuth)
        polar = np.where(lost | math.isinf(bearing.polar_std_rad), upright, polar)
        off = np.remainder(azimuth - at + math.pi, math.tau) - math.pi
        near = share * np.exp(-0.5 * (off / _SPREAD_RAD) ** 2) / (_SPREAD_RAD * math.sqrt(math.tau))
        flat = self._heights.expected_m(self._rng, count) if math.isfinite(ground_m) else None
        if flat is None and math.isinf(bearing.polar_std_rad):
            near = near / 2.0
        elif flat is None:
            near = near * np.exp(-0.5 * ((polar - down) / _SPREAD_RAD) ** 2) / (_SPREAD_RAD * math.sqrt(math.tau))
            near = near / np.maximum(np.sin(polar), 0.1)
        # As bearings show the place, turned by what all of them are off.
        self._heading_rad[which] = heading = self._rng.normal(0.0, bearing.turn.std_rad, count)
        self._elevation_rad[which] = elevation = drawn_elevation(self._rng, count)
        self._axes_rad[which] = drawn_axes(self._axes_rng, count)
        azimuth, polar = azimuth - heading, np.clip(polar - elevation, 0.0, math.pi)
        units = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
        range_m = self._ranges_m(_place(bearing), units)
        self._origins_m[which] = _place(bearing) + range_m[:, None] * units
        if flat is None:
            return np.asarray(4.0 * math.pi * near.sum(axis=0) + anywhere)
        self._origins_m[which, 2] = ground_m + flat - bearing.target_p_enu_m[2]
        return np.asarray(math.tau * near.sum(axis=0) + anywhere)

    def _ranges_m(self, place_m: _Floats, units: _Floats) -> _Floats:
        """(M,) along directions (M, 3)."""
        count = len(units)
        low, high = (math.log(reach) for reach in _REACH_M)
        evenly = self._rng.uniform(size=count) < _SPREAD_EVENLY
        range_m = np.where(evenly, self._rng.uniform(*_REACH_M, count), np.exp(self._rng.uniform(low, high, count)))
        crossed_m = self._lines.ranges_m(place_m, units, range_m, reach_m=_REACH_M, rng=self._rng)
        return np.where(self._rng.uniform(size=count) < _CROSSING, crossed_m, range_m)

    def _wander(self, before: Bearing, bearing: Bearing) -> None:
        elapsed_s = max(0.0, bearing.t_mono_ns - before.t_mono_ns) / 1e9
        gone_m = math.dist(before.p_local_enu_m, bearing.p_local_enu_m)
        gone_m += math.dist(before.target_p_enu_m, bearing.target_p_enu_m)
        std_m = math.hypot(self._drift * math.sqrt(DRIFT_ALIKE_M * gone_m), _WALK_M_SQRT_S * math.sqrt(elapsed_s))
        self._heights.wander(std_m)
        self._origins_m = self._origins_m + self._rng.normal(0.0, std_m, self._origins_m.shape)
        driven_m = np.subtract(bearing.target_p_enu_m, before.target_p_enu_m)
        self._origins_m += carried_m(self._axes_rad, driven_m)

    def _turn(self, before: Bearing, bearing: Bearing) -> None:
        """Bearings are turned by what the flight has shown of North; what particles hold of the rest of it follows."""
        old_std, std = before.turn.std_rad, bearing.turn.std_rad
        old = self._heading_rad
        self._heading_rad = old + (bearing.turn.yaw_rad - before.turn.yaw_rad)
        self._log_weight = normalised(self._log_weight + 0.5 * ((old / old_std) ** 2 - (self._heading_rad / std) ** 2))

    def _weigh(self, bearing: Bearing, ground_m: float, drift: float) -> None:
        """Packets that counted before do not count again: a likelihood is raised to the share of the fresh ones."""
        offsets_m = self._origins_m - _place(bearing)
        flat_m = np.hypot(offsets_m[:, 0], offsets_m[:, 1])
        azimuth = np.arctan2(offsets_m[:, 1], offsets_m[:, 0]) + self._heading_rad
        polar = np.clip(np.arctan2(flat_m, offsets_m[:, 2]) + self._elevation_rad, 0.0, math.pi)
        again = elsewhere(bearing, self._lines.directions())
        range_m = np.hypot(flat_m, offsets_m[:, 2])
        found = likelihoods(bearing, azimuth, polar, range_m, elsewhere=again, drift=drift)
        self._share = changed(self._share, bearing.fresh)
        self._multiply(of_bearing(self._share, np.exp(self._log_weight), found, bearing.fresh))
        self._keep_possible(bearing, ground_m)

    def _listen(self, bearing: Bearing) -> None:
        """What all powers say of a particle, in the place of what fewer said. Of the kind of room they say nothing."""
        self._loudness.add(_place(bearing), bearing.power_dbm, bearing.fresh)
        told = self._loudness.evidence(self._origins_m)
        self._multiply(of_power(self._share, np.exp(self._log_weight), told - self._told))
        self._log_weight = normalised(self._log_weight)
        self._told = told

    def _multiply(self, factor: _Floats) -> None:
        """By a likelihood (K, N) of each kind of room and each particle."""
        joint = self._share * factor
        total = joint.sum(axis=0)
        self._share = joint / total
        self._log_weight = self._log_weight + np.log(total)

    def _height_m(self, origins_m: _Floats, bearing: Bearing, ground_m: float) -> _Floats:
        """(N,) of targets above the ground; 0 where that is not known."""
        height_m = origins_m[:, 2] + bearing.target_p_enu_m[2] - ground_m
        return height_m if math.isfinite(ground_m) else np.zeros(len(origins_m))

    def _log_reach(self, origins_m: _Floats, bearing: Bearing) -> _Floats:
        """(N,) what the fence says of places, before anything is seen there."""
        places_m = origins_m + np.array(bearing.target_p_enu_m)
        beyond = np.zeros(len(places_m), bool) if self._reach is None else ~self._reach(places_m)
        return np.asarray(-self._against * beyond)

    def _keep_possible(self, bearing: Bearing, ground_m: float) -> None:
        height_m = self._height_m(self._origins_m, bearing, ground_m)
        log_weight = self._log_weight + self._heights.log_seen_again(height_m, bearing.fresh, self._stood)
        fenced = self._log_reach(self._origins_m, bearing)
        self._log_weight = normalised(log_weight + fenced - self._fenced)
        self._stood, self._fenced = self._heights.log_prior(height_m), fenced

    def _bear(self, bearing: Bearing, ground_m: float) -> None:
        """The lightest particles die for new ones, before the bearing is weighed, but none that are new themselves.
        Those that are drawn where it points are the less likely the denser they are there, so that it does not count
        twice."""
        everything = len(self._log_weight)
        count = max(1, round(_BORN * everything * bearing.fresh))
        moved = round(_MOVED * everything * bearing.fresh)
        self._age += bearing.fresh
        mortal = np.where(self._age < _GROWN, math.inf, self._log_weight)
        lightest = np.argpartition(mortal, count + moved)[: count + moved]
        self._age[lightest[:count]] = 0.0
        self._age[lightest[count:]] = math.inf
        density, fenced_at_most = self._draw(bearing, ground_m, lightest[:count], 0.0), self._fenced.max()
        self._move(bearing, ground_m, lightest[count:])
        stood = self._heights.log_prior(self._height_m(self._origins_m[lightest], bearing, ground_m))
        fenced = self._log_reach(self._origins_m[lightest], bearing)
        drawn = fenced.copy() if self._heights.is_expected else fenced + stood
        drawn[:count] -= np.log(np.maximum(density, 1.0)) + fenced_at_most
        drawn[count:] -= self._fenced[lightest[count:]]  # of those they are moved from
        self._stood[lightest], self._fenced[lightest] = stood, fenced
        self._log_weight[lightest] = math.log(_NEWBORN / everything) + drawn
        self._share[:, lightest[:count]] = self.rooms()[:, None]
        self._log_weight -= math.log(float(np.exp(self._log_weight).sum()))
        # As good as the others are on the average, until the next power is heard.
        self._told[lightest] = np.exp(self._log_weight) @ self._told

    def _move(self, bearing: Bearing, ground_m: float, which: npt.NDArray[np.intp]) -> None:
        """Makes the particles `which` (M,) others of the belief, nearer or farther on the same line of sight."""
        weight = np.exp(self._log_weight)
        like = self._rng.choice(len(weight), len(which), p=weight / weight.sum())
        offsets_m = self._origins_m[like] - _place(bearing)
        by = self._rng.uniform(0.0, _MOVED_BY, len(which))
        offsets_m *= np.exp(self._rng.normal(0.0, by))[:, None]
        self._origins_m[which] = _place(bearing) + offsets_m
        flat = self._heights.expected_m(self._rng, len(which)) if math.isfinite(ground_m) else None
        if flat is not None:
            self._origins_m[which, 2] = ground_m + flat - bearing.target_p_enu_m[2]
        for constant in (self._heading_rad, self._elevation_rad, self._axes_rad):
            constant[which] = constant[like]
        self._share[:, which], self._fenced[which] = self._share[:, like], self._fenced[like]

    def _resample(self) -> None:
        weight = np.exp(self._log_weight)
        if 1.0 / float(weight @ weight) > _RESAMPLE_BELOW * len(weight):
            return
        count = max(_PARTICLES, round(_LEFT * len(weight)))
        chosen = systematic(weight / weight.sum(), count)
        assert self._newest is not None
        self._told, self._stood = self._told[chosen], self._stood[chosen]
        self._fenced, self._age = self._fenced[chosen], self._age[chosen]
        here_m = _place(self._newest)
        self._origins_m = here_m + parted(self._origins_m[chosen] - here_m, self._rng)
        self._heading_rad = _kept_to(self._heading_rad[chosen], self._newest.turn.std_rad, self._rng)
        self._axes_rad = _kept_to(self._axes_rad[chosen], AXES_STD_RAD, self._axes_rng)
        self._elevation_rad = self._elevation_rad[chosen] + self._rng.normal(0.0, _TWIN_RAD, count)
        self._share = self._share[:, chosen]
        self._log_weight = np.full(count, -math.log(count))


def _kept_to(angle_rad: _Floats, std_rad: float, rng: np.random.Generator) -> _Floats:
    """Twins of a constant part, with the deviation they were drawn with."""
    return np.asarray(0.995 * angle_rad + rng.normal(0.0, 0.1 * std_rad, len(angle_rad)))


def _place(bearing: Bearing) -> _Floats:
    """Where a bearing was taken (3,), relative to the target's motion: from here it points to the common origin."""
    return np.asarray(np.subtract(bearing.p_local_enu_m, bearing.target_p_enu_m))
