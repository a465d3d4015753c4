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

from companion.log_reader import LoggedMessage
from companion.replay.player import Decided
from companion.sar import ApertureRecord
from companion.streams import APERTURE, STREAMS, Part, Stream

TOLERANCES: Final[Mapping[str, float]] = {"_rad": 1e-3, "_m": 1e-3, "_m_s": 1e-3, "_ns": 0.0, "_s": 1e-9}
"""By the unit at the end of a field's name, the longest that fits: 0.06 deg, 1 mm, 1 mm/s; times are exact."""
RELATIVE: Final = 1e-3
"""Of any other number, and of a range or its deviation, which far away follow from small angles."""
COMPUTED: Final = frozenset({"compute_s"})
"""How long it took is no decision."""
DECISIONS: Final = tuple(stream for stream in STREAMS if stream.part is Part.DECISION)


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


@dataclass(frozen=True, slots=True)
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


def differences(path: str, ours: Any, theirs: Any) -> Iterator[str]:
    """Every difference of two decoded messages beyond the tolerance of its field, as text."""
    if isinstance(ours, dict) and isinstance(theirs, dict):
        for key in sorted(ours.keys() | theirs.keys()):
            if key not in COMPUTED:
                yield from differences(f"{path}.{key}" if path else key, ours.get(key), theirs.get(key))
    elif isinstance(ours, list) and isinstance(theirs, list):
        if len(ours) != len(theirs):
            yield f"{path} had {len(ours)} entries, has {len(theirs)}"
            return
        for index, (a, b) in enumerate(zip(ours, theirs, strict=True)):
            yield from differences(f"{path}[{index}]", a, b)
    elif not _same(path, ours, theirs):
        yield f"{path} was {ours}, is {theirs}"


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
    return StreamCheck(stream.topic, len(old), len(new), identical, difference)


def _differs(stream: Stream, message: LoggedMessage, decided: Decided) -> Iterable[str]:
    if message.sequence != decided.event & 0xFFFFFFFF:
        yield f"was decided in event {message.sequence}, is in event {decided.event}"
    yield from differences("", _decoded(stream, message.data), _decoded(stream, decided.data))


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


def _same(path: str, ours: Any, theirs: Any) -> bool:
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (ours, theirs))
    if not numbers or ours == theirs:
        return bool(ours == theirs)
    name = path.rpartition(".")[2].partition("[")[0]
    unit = max((unit for unit in TOLERANCES if name.endswith(unit)), key=len, default="")
    if unit == "_rad":
        return abs(math.remainder(ours - theirs, math.tau)) <= TOLERANCES[unit]
    relative = RELATIVE * max(abs(ours), abs(theirs)) if not unit or name.startswith("range") else 0.0
    return bool(abs(ours - theirs) <= max(TOLERANCES.get(unit, 0.0), relative))


def _since(message: LoggedMessage, start_ns: int) -> float:
    return (message.log_time_ns - start_ns) / 1e9
