"""The team's process: news on standard input, once a second; what is known of the team on standard output.

Started by `companion.team.process`; ends with its input, and with the service that started it.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from queue import SimpleQueue
from typing import BinaryIO

import msgspec

from companion.host.priority import stand_back
from companion.team.estimate import Team
from companion.team.news import LENGTH, News, framed
from companion.team.records import TeamState


def take(team: Team, news: Sequence[News]) -> TeamState | None:
    """All that has come; one update for it, so that a process that is behind does not stay so."""
    for one in news:
        for robot, boot, t_ns, p_m in one.places:
            team.add_place(robot, t_ns, p_m, boot)
        for sighting in one.sightings:
            team.add_sighting(sighting)
    begun_s = time.process_time()
    state = team.update(news[-1].now_ns)
    return None if state is None else replace(state, solve_s=time.process_time() - begun_s)


def main() -> None:
    stand_back(nice=15)
    own, *others = map(int, sys.argv[1:])
    team, waiting = Team(own, others), SimpleQueue[News]()
    threading.Thread(target=_read, args=(sys.stdin.buffer, waiting), daemon=True).start()
    while True:
        news = [waiting.get()]
        while not waiting.empty():
            news.append(waiting.get())
        state = take(team, news)
        if state is not None:
            sys.stdout.buffer.write(framed(state))
            sys.stdout.buffer.flush()


def _read(source: BinaryIO, waiting: SimpleQueue[News]) -> None:
    """Until the service is gone, which ends this process at once: nobody would hear it."""
    while len(head := source.read(LENGTH.size)) == LENGTH.size:
        waiting.put(msgspec.msgpack.decode(source.read(LENGTH.unpack(head)[0]), type=News))
    os._exit(0)


if __name__ == "__main__":
    main()
