"""What comes of one SAR iteration: its aperture for the log, its bearing for the tracker."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from companion.core.messages import Vector3
from companion.sensing.frame_turn import UNKNOWN, FrameTurn
from wsr.aoa import AoaEstimate
from wsr.crb.informativeness import Informativeness
from wsr.directions import Peak


@dataclass(frozen=True, slots=True, kw_only=True)
class Iteration:
    """One SAR iteration for one peer, whatever came of it. `estimate.reference_t_s` counts from `start_ns`."""

    number: int
    peer: int
    start_ns: int
    end_ns: int
    fresh: float
    """Share of its time that no bearing of this peer has told of before, in 0..1: apertures of one flight overlap."""
    reference_ns: int
    """Time of the reference point; `end_ns` when there is no estimate."""
    p_local_enu_m: Vector3 | None
    """Reference point in the autopilot's local frame, where its position was known then."""
    peer_p_enu_m: Vector3 | None
    """Where the peer's antenna was at `reference_ns`, in its own frame; None when there is no estimate."""
    peer_boot: int
    """Boot of the peer in which that frame holds."""
    received: int
    power_dbm: float
    """Mean power of the packets received."""
    dropped: Mapping[str, int]
    compute_s: float
    estimate: AoaEstimate | None
    refusal: str
    informativeness: Informativeness | None = None
    """Of this leg's aperture; None for a refusal."""
    turn: FrameTurn = UNKNOWN
    """From the axes of the estimate, the pose source's, to the local frame's."""

    def bearing(self) -> Bearing | None:
        """What the tracker takes; None where nothing can steer."""
        estimate = self.estimate
        if estimate is None or self.p_local_enu_m is None or self.peer_p_enu_m is None:
            return None
        if not estimate.azimuth_observable:
            return None
        turn = self.turn
        return Bearing(
            t_mono_ns=self.reference_ns,
            p_local_enu_m=self.p_local_enu_m,
            azimuth_rad=estimate.azimuth_rad + turn.yaw_rad,
            polar_rad=estimate.polar_rad,
            azimuth_std_rad=estimate.azimuth_std_rad,
            polar_std_rad=estimate.polar_std_rad if estimate.polar_observable else math.inf,
            target_p_enu_m=self.peer_p_enu_m,
            target_boot=self.peer_boot,
            reliability=estimate.reliability,
            range_m=estimate.range_m,
            range_std_m=estimate.range_std_m,
            others=tuple(replace(path, azimuth_rad=path.azimuth_rad + turn.yaw_rad) for path in estimate.paths[1:]),
            turn=turn,
            fresh=self.fresh,
            power_dbm=self.power_dbm,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ApertureRecord:
    """The aperture of one SAR iteration for the log: M packets as bytes, little-endian: `t_s` f64 (M,) from
    `start_ns`, `chi_m` f64 (M, 3), `channel` c128 (M,); as in `wsr.aperture.Aperture`."""

    number: int
    peer: int
    start_ns: int
    end_ns: int
    t_s: bytes
    chi_m: bytes
    channel: bytes
    wavelength_m: float
    reference_p_m: Vector3

    def positions_m(self) -> npt.NDArray[np.float64]:
        """Path (M, 3) of our antenna relative to the peer's motion."""
        return np.asarray(np.frombuffer(self.chi_m).reshape(-1, 3) + np.array(self.reference_p_m))


@dataclass(frozen=True, slots=True, kw_only=True)
class Bearing:
    """One direction to a target: from `p_local_enu_m` along azimuth and polar angle, at `t_mono_ns`.

    `target_p_enu_m` is where the target then was by its own poses: in North-aligned axes about an origin of its own,
    which lasts as long as its boot `target_boot`. `reliability` is in 0..1.
    """

    t_mono_ns: int
    p_local_enu_m: Vector3
    azimuth_rad: float
    polar_rad: float
    azimuth_std_rad: float
    polar_std_rad: float
    """Infinite where the aperture did not tell the polar angle: then the bearing is a half plane."""
    target_p_enu_m: Vector3
    target_boot: int
    reliability: float
    range_m: float | None = None
    """By the curvature of the wave front; None where it does not show."""
    range_std_m: float = math.inf
    others: tuple[Peak, ...] = ()
    """Other paths the aperture found."""
    turn: FrameTurn = UNKNOWN
    """By which all directions were turned into the local frame."""
    fresh: float = 1.0
    """The share of its packets that no bearing before had."""
    power_dbm: float = math.nan
    """Mean power of the packets received."""
