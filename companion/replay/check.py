"""Recorded decisions against replayed ones, stream by stream, within stated tolerances.

On the machine that recorded, a replay is exact. The tolerances allow for another processor, whose compiled kernel may
round differently, and for nothing else: they are far below anything that would change a flight.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np
import numpy.typing as npt

from companion.core.streams import APERTURE, STREAMS, TARGET, Part, Stream
from companion.log.reader import LoggedMessage
from companion.replay.player import Decided
from companion.sensing.records import ApertureRecord

TOLERANCES: Final[Mapping[str, float]] = {
    "_rad": 1e-3, "_m": 2e-2, "_m_s": 1e-3, "_turns": 1e-2, "_ns": 0.0, "_s": 1e-9,
}  # fmt: skip
"""By the unit at the end of a field's name, the longest that fits: 0.06 deg and what that is at 20 m, 2 cm; 1 mm/s;
times are exact."""
RELATIVE: Final = 1e-2
"""Of any other number, and of a range, which far away follows from small angles."""
UNCERTAINTY: Final = 0.1
"""Of the deviation of a range, of the covariances with it as shares of both deviations, and of noise (rad^-2): where
the curvature that they follow from is nearly none, its rounding is a large share. Of no range there is no deviation."""
_RANGE: Final = 2
PLACE: Final = 0.03
"""Of the deviation of a target's place: its own, its rivals' and its covariance's, and of the angle that holds 90 % of
it. Each particle that is drawn or not moves them."""
COMPUTED: Final = frozenset({"compute_s"})
"""How long it took is no decision."""
DECISIONS: Final = tuple(stream for stream in STREAMS if stream.part is Part.DECISION)

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Difference:
    """The first place at which a stream differs."""

    index: int
    """Of the message in its stream."""
    t_s: float | None
    """Since the first event; None where nothing was recorded."""
    what: str

    def __str__(self) -> str:
        at = "" if self.t_s is None else f" at {self.t_s:.2f} s"
        return f"message {self.index}{at}: {self.what}"


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamCheck:
    """One stream of decisions: how many messages, how many byte for byte the same, and the first difference."""

    topic: str
    recorded: int
    replayed: int
    identical: int
    difference: Difference | None


def check(recorded: Sequence[LoggedMessage], replayed: Sequence[Decided], start_ns: int) -> list[StreamCheck]:
    """Every stream of decisions. `start_ns` is the wall time from which differences are told."""
    return [_check_stream(stream, recorded, replayed, start_ns) for stream in DECISIONS]


def differences(path: str, ours: Any, theirs: Any, place_m: float = TOLERANCES["_m"]) -> Iterator[str]:
    """Every difference of two decoded messages beyond the tolerance of its field, as text; `place_m` is that of places
    in them."""
    if isinstance(ours, dict) and isinstance(theirs, dict):
        no_range = "range_m" in ours and ours["range_m"] is None and theirs.get("range_m") is None
        for key in sorted(ours.keys() | theirs.keys()):
            at = f"{path}.{key}" if path else key
            if key in COMPUTED or (no_range and key == "range_std_m"):
                continue
            if key == "covariance" and all(isinstance(one.get(key), list) for one in (ours, theirs)):
                known = slice(_RANGE if no_range else None)
                a, b = (np.array(one[key], float)[known, known] for one in (ours, theirs))
                yield from _covariance_differs(at, a, b)
            elif key == "covariance_m2" and all(isinstance(one.get(key), list) for one in (ours, theirs)):
                yield from _place_differs(at, np.array(ours[key], float), np.array(theirs[key], float))
            else:
                yield from differences(at, ours.get(key), theirs.get(key), place_m)
    elif isinstance(ours, list) and isinstance(theirs, list):
        if len(ours) != len(theirs):
            yield f"{path} had {len(ours)} entries, has {len(theirs)}"
            return
        for index, (a, b) in enumerate(zip(ours, theirs, strict=True)):
            yield from differences(f"{path}[{index}]", a, b, place_m)
    elif not _same(path, ours, theirs, place_m):
        yield f"{path} was {ours}, is {theirs}"


def _place_differs(at: str, ours: Array, theirs: Array) -> Iterator[str]:
    """Covariances (3, 3) of a place: each as a share of both deviations."""
    scale = PLACE * np.sqrt(np.outer(np.diag(ours), np.diag(ours)))
    for i, j in np.argwhere(~(np.abs(ours - theirs) <= scale)).tolist():
        yield f"{at}[{i}][{j}] was {ours[i, j]}, is {theirs[i, j]}"


def _check_stream(
    stream: Stream, recorded: Sequence[LoggedMessage], replayed: Sequence[Decided], start_ns: int
) -> StreamCheck:
    old = [message for message in recorded if message.topic == stream.topic]
    new = [decided for decided in replayed if decided.stream.topic == stream.topic]
    identical, difference = 0, None
    for index, (message, decided) in enumerate(zip(old, new, strict=False)):
        if message.data == decided.data and message.sequence == decided.event & 0xFFFFFFFF:
            identical += 1
        elif difference is None:
            found = list(_differs(stream, message, decided))
            if found:
                difference = Difference(index, _since(message, start_ns), "; ".join(found[:4]))
    if difference is None and len(old) != len(new):
        longer = "recorded" if len(old) > len(new) else "replayed"
        t_s = _since(old[len(new)], start_ns) if len(old) > len(new) else None
        difference = Difference(min(len(old), len(new)), t_s, f"only {longer} from here on")
    return StreamCheck(
        topic=stream.topic, recorded=len(old), replayed=len(new), identical=identical, difference=difference
    )


def _differs(stream: Stream, message: LoggedMessage, decided: Decided) -> Iterable[str]:
    if message.sequence != decided.event & 0xFFFFFFFF:
        yield f"was decided in event {message.sequence}, is in event {decided.event}"
    ours, theirs = _decoded(stream, message.data), _decoded(stream, decided.data)
    place_m = TOLERANCES["_m"]
    if stream is TARGET:
        place_m = max(place_m, PLACE * math.sqrt(np.trace(np.array(ours["target"]["covariance_m2"], float))))
    yield from differences("", ours, theirs, place_m)


def _decoded(stream: Stream, data: bytes) -> Any:
    if stream is not APERTURE:
        return msgspec.json.decode(data)
    record = msgspec.msgpack.decode(data, type=ApertureRecord)
    channel = np.frombuffer(record.channel, np.complex128)
    return {
        "number": record.number,
        "peer": record.peer,
        "start_ns": record.start_ns,
        "end_ns": record.end_ns,
        "t_s": np.frombuffer(record.t_s).tolist(),
        "chi_m": np.frombuffer(record.chi_m).tolist(),
        "channel_re": channel.real.tolist(),
        "channel_im": channel.imag.tolist(),
        "wavelength_m": record.wavelength_m,
        "reference_p_m": list(record.reference_p_m),
    }


def _same(path: str, ours: Any, theirs: Any, place_m: float) -> bool:
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (ours, theirs))
    if not numbers or ours == theirs:
        return bool(ours == theirs)
    name = path.rpartition(".")[2].partition("[")[0]
    unit = max((unit for unit in TOLERANCES if name.endswith(unit)), key=len, default="")
    if name in ("p_local_enu_m", "origin_local_enu_m"):
        return bool(abs(ours - theirs) <= place_m)
    if name == "probability":
        return bool(abs(ours - theirs) <= RELATIVE)
    if unit == "_rad":
        share = PLACE * abs(ours) if name == "direction_90_rad" else 0.0
        return abs(math.remainder(ours - theirs, math.tau)) <= max(TOLERANCES[unit], share)
    if name == "range_std_m" or name.endswith("rad2"):
        share = UNCERTAINTY
    else:
        share = RELATIVE if not unit or name.startswith("range") else 0.0
    return bool(abs(ours - theirs) <= max(TOLERANCES.get(unit, 0.0), share * max(abs(ours), abs(theirs))))


def _covariance_differs(path: str, ours: Array, theirs: Array) -> Iterator[str]:
    """Of azimuth, polar angle and range, nan where there is none: entries are compared as shares of the deviations."""
    if ours.shape != theirs.shape:
        yield f"{path} was {ours.shape}, is {theirs.shape}"
        return
    deviation = np.sqrt(np.fmax(np.diag(ours), np.diag(theirs)))
    share = np.where(np.maximum(*np.indices(ours.shape)) == _RANGE, UNCERTAINTY, RELATIVE)
    close = np.abs(ours - theirs) <= share * np.outer(deviation, deviation)
    for i, j in np.argwhere(~(close | (ours == theirs) | (np.isnan(ours) & np.isnan(theirs)))):
        yield f"{path}[{i}][{j}] was {ours[i, j]}, is {theirs[i, j]}"


def _since(message: LoggedMessage, start_ns: int) -> float:
    return (message.log_time_ns - start_ns) / 1e9
