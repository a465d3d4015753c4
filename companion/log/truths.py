"""The truth of a flight: in its log, or in a file beside it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import msgspec

from companion.config.schema import Config
from companion.core.streams import TRUTH
from companion.log.reader import LogScan, Session
from companion.log.records import LoggedIteration, TruthTrack
from companion.log.truth import TRUTH_NAME, Truth


def truth_of(session: Session) -> TruthTrack:
    """The truth in the log itself or else in truth.mcap beside it; empty where there is none, or of another time."""
    beside = session.paths[0].with_name(TRUTH_NAME)
    for path in (*session.paths, *([beside] if beside.is_file() else [])):
        track = TruthTrack(_read(path))
        if track:
            return track
    return TruthTrack(())


def true_azimuths(
    session: Session, config: Config, iterations: Iterable[LoggedIteration]
) -> dict[tuple[int, int], float]:
    """True azimuth [rad] by (peer, reference_ns) of each iteration, where the truth knows it."""
    track = truth_of(session)
    names = {peer.id: peer.name for peer in config.peers}
    found = {}
    for one in iterations:
        if (bearing := track.bearing(one.reference_ns, names.get(one.peer, ""))) is not None:
            found[one.peer, one.reference_ns] = bearing[0]
    return found


def _read(path: Path) -> list[Truth]:
    return [msgspec.json.decode(message.data, type=Truth) for message in LogScan(path, {TRUTH.topic})]
