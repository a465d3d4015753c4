"""Logs of one flight from several robots, and the autopilot's own, as one file on the first one's time.

A robot's clock is related to the first one's by the exchanges that both recorded: the frame counter tells which packets
belong together, whatever the clocks say. Without counters, and for the truth of a simulator on the same machine, wall
times are taken as they are.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from companion.core.streams import VEHICLE
from companion.errors import CompanionError
from companion.log.exchanges import between, check_identity, exchanges_of
from companion.log.reader import LoggedMessage, Progress, Session, open_session
from companion.log.repair import copy, new_log
from companion.log.ulog import PREFIX, Ulog, clock_offset_s

_LEAST_EXCHANGES = 20
_WIDEST_SPREAD_S = 0.05
"""Both ends of an exchange take it from their sockets within milliseconds, on a loaded host within tens."""


@dataclass(frozen=True, slots=True)
class Joined:
    """How one log was joined to the first."""

    path: Path
    prefix: str
    """Before its topics."""
    offset_s: float
    """Added to its times."""
    how: str


def merge(
    first: Path, others: Sequence[Path], ulog: Path | None, target: Path, progress: Progress | None = None
) -> list[Joined]:
    """Writes `target`. The first log keeps its topics, each other gets its robot's name before them, the truth keeps
    its own. Raises CompanionError."""
    base = open_session(first)
    recordings = {base.metadata.get("session"): first}
    for path in others:
        recording = open_session(path).metadata.get("session")
        if recording and recording in recordings:
            raise CompanionError(
                f"{path}: is of the same recording as {recordings[recording]}; expected another robot's"
            )
        recordings[recording] = path
    joined = [_join(base, path) for path in others]
    sources: list[Iterator[_Timed]] = [((m.log_time_ns, "", 0, m) for m in base.messages(progress=progress))]
    for path, one in zip(others, joined, strict=True):
        sources.append(_shifted(open_session(path), one.prefix, round(one.offset_s * 1e9)))
    if ulog is not None:
        opened = Ulog(ulog)
        offset_s, rms_m = clock_offset_s(ulog, opened.positions(), _vehicle_track(base))
        damaged = "; damaged, what could be read is there" if opened.is_damaged else ""
        joined.append(Joined(ulog, PREFIX, offset_s, f"positions agree to {rms_m:.2f} m{damaged}"))
        sources.append(_px4(opened, round(offset_s * 1e9)))
    with new_log(target, base.metadata) as writer:
        for number, one in enumerate(joined):
            values = {"file": one.path.name, "prefix": one.prefix, "offset_s": repr(one.offset_s), "how": one.how}
            writer.add_metadata(f"joined {number}", values)
        for _, prefix, offset_ns, message in heapq.merge(*sources, key=lambda timed: timed[0]):
            copy(writer, message, prefix, offset_ns)
    return joined


_Timed = tuple[int, str, int, LoggedMessage]


def _join(base: Session, path: Path) -> Joined:
    session = open_session(path)
    role = session.metadata.get("role", "")
    if role == "truth":
        # Same machine: both clocks are the monotonic one, and the wall clock may have stepped in between.
        offset_ns = base.wall_minus_mono_ns - session.wall_minus_mono_ns
        return Joined(path, "", offset_ns / 1e9, "same monotonic clock")
    prefix = f"/{session.metadata.get('name') or path.stem}"
    ours, theirs = exchanges_of(base), exchanges_of(session)
    check_identity(base, session, path, theirs)
    ours, theirs = between(base, session, ours, theirs)
    best: tuple[int, float, float] | None = None
    for our_times in ours.values():
        for their_times in theirs.values():
            common = sorted(our_times.keys() & their_times.keys())
            lags = np.array([our_times[frame][0] - their_times[frame][0] for frame in common], float) / 1e9
            if len(lags) >= _LEAST_EXCHANGES and (best is None or len(lags) > best[0]):
                best = len(lags), float(np.median(lags)), _spread_s(lags)
    if best is None:
        _check_same_time(base, session, path)
        return Joined(path, prefix, 0.0, f"by wall clock: fewer than {_LEAST_EXCHANGES} exchanges in common")
    count, offset_s, spread_s = best
    if spread_s > _WIDEST_SPREAD_S:
        raise CompanionError(
            f"{path}: not of this flight: {count} exchanges have numbers in common, but not their times (spread "
            f"{1e3 * spread_s:.0f} ms, expected below {1e3 * _WIDEST_SPREAD_S:.0f})"
        )
    return Joined(path, prefix, offset_s, f"{count} exchanges in common, spread {1e3 * spread_s:.2f} ms")


def _spread_s(lags_s: np.ndarray) -> float:
    """Median deviation of one clock less the other, (N,) in the order of exchanges, from its course: crystals drift,
    by less within each of a few stretches than one exchange is late."""
    stretches = np.array_split(lags_s, min(20, max(1, len(lags_s) // _LEAST_EXCHANGES)))
    return float(np.median(np.concatenate([np.abs(part - np.median(part)) for part in stretches])))


def _check_same_time(base: Session, session: Session, path: Path) -> None:
    """Raises CompanionError where the wall clocks, which would decide, were not of one time."""
    ours, theirs = _span_ns(base), _span_ns(session)
    if ours is not None and theirs is not None and (ours[0] > theirs[1] or theirs[0] > ours[1]):
        raise CompanionError(
            f"{path}: cannot be put on the time of {base.paths[0]}: fewer than {_LEAST_EXCHANGES} exchanges in common, "
            "and its wall clock was at another time altogether"
        )


def _span_ns(session: Session) -> tuple[int, int] | None:
    """First and last log time; None where there is none."""
    first = last = None
    for message in session.messages():
        first = message.log_time_ns if first is None else min(first, message.log_time_ns)
        last = message.log_time_ns if last is None else max(last, message.log_time_ns)
    return None if first is None or last is None else (first, last)


def _vehicle_track(session: Session) -> tuple[np.ndarray, np.ndarray]:
    rows: dict[int, list[float]] = {}
    for message in session.messages({VEHICLE.topic}):
        state = msgspec.json.decode(message.data)
        if state["p_local_enu_m"] is not None:
            rows[state["position_mono_ns"] + session.wall_minus_mono_ns] = state["p_local_enu_m"]
    times = sorted(rows)
    return np.array(times, float) / 1e9, np.array([rows[t] for t in times]).reshape(-1, 3)


def _shifted(session: Session, prefix: str, offset_ns: int) -> Iterator[_Timed]:
    for message in session.messages():
        yield message.log_time_ns + offset_ns, prefix, offset_ns, message


def _px4(ulog: Ulog, offset_ns: int) -> Iterator[_Timed]:
    """In the order of time; a .ulg is read whole anyway."""
    rows = sorted(ulog.messages(), key=lambda row: row[1])
    for topic, t_ns, data in rows:
        yield (
            t_ns + offset_ns,
            "",
            offset_ns,
            LoggedMessage(topic=topic, log_time_ns=t_ns, data=data, publish_time_ns=t_ns, sequence=0, encoding="json"),
        )
