"""A log in which a person names another robot in flight: a replay of it is that flight again, to the byte."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import msgspec
import numpy as np
import pytest

from companion.config.schema import Config, Peer
from companion.core.inputs import Event, Wish
from companion.core.streams import MISSION, SETPOINT, TICK, WISH
from companion.log.reader import LoggedMessage, Session
from companion.replay.player import INPUT_TOPICS
from tests.golden.golden_logs import GOLDEN, replayed_as

_SECOND = 9


class _Changed(Session):
    """A golden log with a second robot in its configuration, and a wish to fly there near its end. It is silent: no
    service would grant that, but it decides more."""

    def config(self) -> Config:
        config = super().config()
        return dataclasses.replace(config, peers=[*config.peers, Peer(_SECOND, "second", "00:21:6A:00:00:09", "none")])

    def messages(self, *asked: object, **others: object) -> Iterator[LoggedMessage]:
        kept = list(super().messages(INPUT_TOPICS))
        end_ns, shift = kept[-1].log_time_ns, 0
        for message in kept:
            if not shift and message.topic == TICK.topic and message.log_time_ns > end_ns - 2_500_000_000:
                now_ns = message.log_time_ns - self.wall_minus_mono_ns
                wish = Wish(t_mono_ns=now_ns, wish=Event.RETARGET, refusal="", target=_SECOND)
                yield LoggedMessage(
                    topic=WISH.topic, log_time_ns=message.log_time_ns, data=msgspec.json.encode(wish),
                    sequence=message.sequence,
                )  # fmt: skip
                shift = 1
            yield dataclasses.replace(message, sequence=message.sequence + shift)


@pytest.mark.long
def test_a_change_of_target_is_replayed_to_the_byte_and_makes_no_step() -> None:
    (path,) = GOLDEN
    first, second = replayed_as(_Changed, path), replayed_as(_Changed, path)
    assert first.as_json() == second.as_json()
    steps = [msgspec.json.decode(one.data) for one in first.decided if one.stream is MISSION]
    named = next(k for k, one in enumerate(steps) if one["event"] == "retarget")
    assert [(one["state"], one["event"], one["next_state"]) for one in steps[named - 1 : named + 2]] == [
        ("approaching", "bearing_stale", "holding"),
        ("holding", "retarget", "acquiring"),
        ("acquiring", "bearing_stale", "holding"),
    ]
    v = np.array([msgspec.json.decode(one.data)["v_local_enu_m_s"] for one in first.decided if one.stream is SETPOINT])
    assert np.abs(np.diff(v, n=2, axis=0)).max() / 0.05 < 0.5
