"""The team's process: news on standard input, once a second; what is known of the team on standard output.

Started by `companion.team.process`; ends with its input, and with the service that started it.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import msgspec

from companion.host.priority import stand_back
from companion.team.estimate import Team
from companion.team.news import LENGTH, News, framed
from companion.team.records import TeamState


def take(team: Team, news: News) -> TeamState | None:
    for robot, boot, t_ns, p_m in news.places:
        team.add_place(robot, t_ns, p_m, boot)
    for sighting in news.sightings:
        team.add_sighting(sighting)
    begun_s = time.process_time()
    state = team.update(news.now_ns)
    return None if state is None else replace(state, solve_s=time.process_time() - begun_s)


def main() -> None:
    stand_back(nice=15)
    own, *others = map(int, sys.argv[1:])
    team = Team(own, others)
    source, sink = sys.stdin.buffer, sys.stdout.buffer
    while len(head := source.read(LENGTH.size)) == LENGTH.size:
        body = source.read(LENGTH.unpack(head)[0])
        state = take(team, msgspec.msgpack.decode(body, type=News))
        if state is not None:
            sink.write(framed(state))
            sink.flush()


if __name__ == "__main__":
    main()
