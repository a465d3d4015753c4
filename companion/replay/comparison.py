"""Two configurations on one flight, side by side: each SAR iteration as it was and as it would have been."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import msgspec

from companion.core.streams import BEARING, MISSION
from companion.log.reader import LoggedMessage
from companion.log.records import LoggedIteration
from companion.replay.player import Decided
from wsr.geometry import direction as unit_vector
from wsr.geometry import great_circle, wrap_angle


@dataclass(frozen=True, slots=True, kw_only=True)
class BearingRow:
    """One iteration for one peer; None where the side has no bearing. Angles in degrees."""

    peer: int
    t_s: float
    recorded_azimuth_deg: float | None
    replayed_azimuth_deg: float | None
    moved_deg: float | None
    """Great circle between the two, or along the horizon where a polar angle is not observable."""
    recorded_reliability: float | None
    replayed_reliability: float | None
    recorded_error_deg: float | None
    """Azimuth against the truth, where there is one."""
    replayed_error_deg: float | None
    recorded_refusal: str
    """Why there is no bearing; empty where there is one, or no such iteration."""
    replayed_refusal: str


@dataclass(frozen=True, slots=True)
class Step:
    """One transition of the mission."""

    t_s: float
    text: str


def bearing_rows(
    recorded: Sequence[LoggedIteration],
    replayed: Sequence[LoggedIteration],
    start_ns: int,
    true_azimuths_rad: Mapping[tuple[int, int], float],
) -> list[BearingRow]:
    """Iterations of the same peer whose times overlap stand in one row. `true_azimuths_rad` by (peer, reference_ns)."""
    rows, left = [], list(replayed)
    for old in recorded:
        new = next(
            (i for i in left if i.peer == old.peer and i.start_ns < old.end_ns and old.start_ns < i.end_ns), None
        )
        if new is not None:
            left.remove(new)
        rows.append(_row(old, new, start_ns, true_azimuths_rad))
    rows += [_row(None, new, start_ns, true_azimuths_rad) for new in left]
    return sorted(rows, key=lambda row: (row.t_s, row.peer))


def iterations_of(messages: Sequence[LoggedMessage] | Sequence[Decided]) -> list[LoggedIteration]:
    """The SAR iterations among messages of either side."""
    return [msgspec.json.decode(m.data, type=LoggedIteration) for m in messages if _topic(m) == BEARING.topic]


def mission_steps(messages: Sequence[LoggedMessage] | Sequence[Decided], start_ns: int) -> list[Step]:
    """Transitions of the mission among messages of either side."""
    steps = [msgspec.json.decode(m.data) for m in messages if _topic(m) == MISSION.topic]
    return [
        Step((s["t_mono_ns"] - start_ns) / 1e9, f"{s['state']} -> {s['next_state']} on {s['event']}") for s in steps
    ]


def _topic(message: LoggedMessage | Decided) -> str:
    return message.topic if isinstance(message, LoggedMessage) else message.stream.topic


def _row(
    old: LoggedIteration | None,
    new: LoggedIteration | None,
    start_ns: int,
    truth: Mapping[tuple[int, int], float],
) -> BearingRow:
    one = old or new
    assert one is not None
    a, b = (side.estimate if side is not None else None for side in (old, new))
    moved = None
    if a is not None and b is not None:
        flat = not (a.polar_observable and b.polar_observable)
        moved = abs(float(wrap_angle(a.azimuth_rad - b.azimuth_rad)))
        if not flat:
            moved = float(
                great_circle(unit_vector(a.azimuth_rad, a.polar_rad), unit_vector(b.azimuth_rad, b.polar_rad))
            )
    return BearingRow(
        peer=one.peer,
        t_s=(one.reference_ns - start_ns) / 1e9,
        recorded_azimuth_deg=math.degrees(a.azimuth_rad) if a else None,
        replayed_azimuth_deg=math.degrees(b.azimuth_rad) if b else None,
        moved_deg=None if moved is None else math.degrees(moved),
        recorded_reliability=a.reliability if a else None,
        replayed_reliability=b.reliability if b else None,
        recorded_error_deg=_error_deg(old, truth),
        replayed_error_deg=_error_deg(new, truth),
        recorded_refusal=old.refusal if old else "",
        replayed_refusal=new.refusal if new else "",
    )


def _error_deg(iteration: LoggedIteration | None, truth: Mapping[tuple[int, int], float]) -> float | None:
    if iteration is None or iteration.estimate is None:
        return None
    true_rad = truth.get((iteration.peer, iteration.reference_ns))
    return None if true_rad is None else math.degrees(float(wrap_angle(iteration.estimate.azimuth_rad - true_rad)))
