"""Bearings in a datagram: 20 bytes each, as the sender's own apertures gave them.

Raw measurements alone: what a robot makes of everybody's is never sent, so that nobody hears his own word as another's.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

MAX_SIGHTINGS: Final = 8
_ROW: Final = struct.Struct("<HHHhHHHHHBB")
_ANGLE_RAD: Final = math.pi / (1 << 15)
_STD_RAD: Final = 1e-4
_NS_PER_AGE: Final = 1_000_000
_METRES: Final = 0.01
_NONE: Final = 0xFFFF
_SHARES: Final = 255


@dataclass(frozen=True, slots=True, kw_only=True)
class Sighting:
    """One bearing of robot `target`, from the sender's antenna, in the sender's North-aligned axes.

    `number` is the sender's own of it, modulo 2^16, `t_ns` when it holds, on the sender's clock. `polar_std_rad` is
    infinite where the aperture did not tell the polar angle; `range_m` is None where no curvature shows. `fresh` is the
    share of its packets that no bearing before had.
    """

    target: int
    number: int
    t_ns: int
    azimuth_rad: float
    azimuth_std_rad: float
    polar_rad: float
    polar_std_rad: float
    range_m: float | None
    range_std_m: float
    reliability: float
    fresh: float


def packed_sightings(sightings: Sequence[Sighting], sent_ns: int) -> bytes:
    """Their number in a byte, then the rows. Raises ValueError for more than fit, or for one older than 65 s."""
    if len(sightings) > MAX_SIGHTINGS:
        raise ValueError(f"{len(sightings)} bearings, at most {MAX_SIGHTINGS}")
    rows = []
    for one in sightings:
        age = round((sent_ns - one.t_ns) / _NS_PER_AGE)
        if not 0 <= age < 1 << 16:
            raise ValueError("bearings must be at most 65 s old")
        azimuth = (round(one.azimuth_rad / _ANGLE_RAD) + (1 << 15)) % (1 << 16) - (1 << 15)
        rows.append(
            _ROW.pack(
                one.target, one.number & 0xFFFF, age, azimuth, _units(one.azimuth_std_rad, _STD_RAD),
                _units(one.polar_rad, _ANGLE_RAD), _units(one.polar_std_rad, _STD_RAD),
                _NONE if one.range_m is None else _units(one.range_m, _METRES), _units(one.range_std_m, _METRES),
                _share(one.reliability), _share(one.fresh),
            )
        )  # fmt: skip
    return bytes([len(rows)]) + b"".join(rows)


def unpacked_sightings(data: bytes, sent_ns: int) -> tuple[tuple[Sighting, ...], int]:
    """The bearings at the head of `data`, and of how many bytes. Raises ValueError when they are not whole, or say what
    no robot measures."""
    count = data[0] if data else 0
    used = 1 + count * _ROW.size
    if not 0 < count <= MAX_SIGHTINGS or len(data) < used:
        raise ValueError(f"{count} bearings in {len(data)} bytes")
    return tuple(_sighting(row, sent_ns) for row in _ROW.iter_unpack(data[1:used])), used


def _sighting(row: tuple[int, ...], sent_ns: int) -> Sighting:
    target, number, age, azimuth, azimuth_std, polar, polar_std, range_cm, range_std, reliability, fresh = row
    if polar > 1 << 15 or azimuth_std in (0, _NONE) or polar_std == 0 or range_cm == 0:
        raise ValueError(f"a bearing of robot {target} that nothing measures")
    return Sighting(
        target=target,
        number=number,
        t_ns=sent_ns - age * _NS_PER_AGE,
        azimuth_rad=azimuth * _ANGLE_RAD,
        azimuth_std_rad=azimuth_std * _STD_RAD,
        polar_rad=polar * _ANGLE_RAD,
        polar_std_rad=math.inf if polar_std == _NONE else polar_std * _STD_RAD,
        range_m=None if range_cm == _NONE else range_cm * _METRES,
        range_std_m=math.inf if range_std == _NONE else range_std * _METRES,
        reliability=reliability / _SHARES,
        fresh=fresh / _SHARES,
    )


def _units(value: float, unit: float) -> int:
    """At least 1: no deviation and no range is nothing; all that is beyond the row's size for what is not observed."""
    return _NONE if not value / unit < _NONE else max(1, round(value / unit))


def _share(value: float) -> int:
    return round(_SHARES * min(1.0, max(0.0, value)))
