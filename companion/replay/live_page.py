"""A replay in a browser of this machine: the map, the mission and the newest bearing while the log runs.

One page without scripts of others; it asks for the state a few times a second. Listens on the loopback address only.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from aiohttp import web

from companion.core.clock import NS_PER_S
from companion.core.messages import Setpoint
from companion.errors import CompanionError
from companion.log.reader import Session
from companion.replay.player import InputEvent, Player
from companion.replay.result import Replay, ReplayResult
from companion.sensing.records import Iteration

_HOST: Final = "127.0.0.1"
_BATCH_S: Final = 0.02
_PATIENCE_S: Final = 10.0  # the replay begins when the page is opened, or without a viewer after so long
_LINGER_S: Final = 1.0  # for viewers to see the end
_TRAIL: Final = 2000


@dataclass(slots=True)
class LiveState:
    """What the page shows; places in the autopilot's local frame, angles in degrees."""

    t_s: float = 0.0
    is_done: bool = False
    status: dict[str, Any] = field(default_factory=dict)
    trail: list[tuple[float, float]] = field(default_factory=list)
    bearings: list[tuple[float, float, float, float]] = field(default_factory=list)
    """East, North, azimuth [deg], reliability."""


def replay_with_page(
    player: Player, session: Session, speed: float | None, port: int, announce: Callable[[str], None]
) -> ReplayResult:
    """Replays while a page shows it; `announce` is told its address. Raises CompanionError when the port is taken."""
    return asyncio.run(_run(player, session, speed, port, announce))


async def _run(
    player: Player, session: Session, speed: float | None, port: int, announce: Callable[[str], None]
) -> ReplayResult:
    state = LiveState()

    is_seen = asyncio.Event()

    async def page(request: web.Request) -> web.Response:
        is_seen.set()
        return web.Response(text=_HTML, content_type="text/html")

    async def answer(request: web.Request) -> web.Response:
        return web.json_response(asdict(state))

    app = web.Application()
    app.router.add_get("/", page)
    app.router.add_get("/state", answer)
    runner = web.AppRunner(app, access_log=None)
    await runner.setup()
    try:
        site = web.TCPSite(runner, _HOST, port)
        await site.start()
        (address,) = runner.addresses
        announce(f"http://{_HOST}:{address[1]}/")
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(is_seen.wait(), _PATIENCE_S)
        return await _drive(player, session, speed, state)
    except OSError as error:
        raise CompanionError(f"--port {port}: {error.strerror}") from None
    finally:
        await runner.cleanup()


async def _drive(player: Player, session: Session, speed: float | None, state: LiveState) -> ReplayResult:
    replay = Replay(player, session)
    begun, first_ns = time.monotonic(), None
    batch_end, seen = begun + _BATCH_S, 0
    for event in replay.events():
        first_ns = event.t_ns if first_ns is None else first_ns
        now = time.monotonic()
        due = now if speed is None else begun + (event.t_ns - first_ns) / NS_PER_S / speed
        if due > now or now > batch_end or not state.status:
            seen = _show(player, event, first_ns, state, seen)
            await asyncio.sleep(max(0.0, due - now))
            batch_end = time.monotonic() + _BATCH_S
    state.is_done = True
    await asyncio.sleep(_LINGER_S)
    return replay.result()


def _show(player: Player, event: InputEvent, first_ns: int, state: LiveState, seen: int) -> int:
    """Brings the state up to the event; how many decisions have been shown."""
    # What a cut log repeats from before its first event is later than what follows it.
    state.t_s = max(state.t_s, (event.t_ns - first_ns) / NS_PER_S)
    state.status = player.uav.flight.status()
    for decided in player.log.decided[seen:]:
        match decided.source:
            case Setpoint(p_local_enu_m=place) if place is not None:
                state.trail.append((place[0], place[1]))
            case Iteration(estimate=estimate, p_local_enu_m=place) if estimate is not None and place is not None:
                bearing = (place[0], place[1], math.degrees(estimate.azimuth_rad), estimate.reliability)
                state.bearings.append(bearing)
            case _:
                pass
    del state.trail[:-_TRAIL]
    return len(player.log.decided)


_HTML: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>companion replay</title><link rel="icon" href="data:,">
<style>body{font:15px sans-serif;margin:1em;display:flex;gap:2em;flex-wrap:wrap}canvas{border:1px solid #888}
td{padding:.1em .8em .1em 0}th{text-align:left}</style></head>
<body><canvas id="map" width="640" height="640"></canvas>
<div><h1>Replay</h1><table id="status"></table></div>
<script>
const canvas = document.getElementById('map'), pen = canvas.getContext('2d');
function draw(s) {
  const all = s.trail.concat(s.bearings.map(b => [b[0], b[1]]), [[0, 0]]);
  const xs = all.map(p => p[0]), ys = all.map(p => p[1]);
  const x0 = (Math.min(...xs) + Math.max(...xs)) / 2, y0 = (Math.min(...ys) + Math.max(...ys)) / 2;
  const span = Math.max(4, Math.max(...xs) - Math.min(...xs), Math.max(...ys) - Math.min(...ys)) * 1.3;
  const at = (x, y) => [320 + (x - x0) / span * 640, 320 - (y - y0) / span * 640];
  pen.clearRect(0, 0, 640, 640); pen.strokeStyle = '#000'; pen.lineWidth = 1.5; pen.beginPath();
  s.trail.forEach((p, i) => i ? pen.lineTo(...at(...p)) : pen.moveTo(...at(...p))); pen.stroke();
  s.bearings.forEach(b => { const a = b[2] * Math.PI / 180; pen.setLineDash(b[3] < 0.1 ? [3, 4] : []);
    pen.beginPath(); pen.moveTo(...at(b[0], b[1]));
    pen.lineTo(...at(b[0] + 1.6 * Math.cos(a), b[1] + 1.6 * Math.sin(a))); pen.stroke(); });
  pen.setLineDash([]);
}
function table(s) {
  const rows = Object.assign({'time [s]': s.t_s.toFixed(1)}, s.status, {'replay': s.is_done ? 'done' : 'running'});
  const text = v => typeof v === 'number' ? v.toFixed(2) : v && typeof v === 'object' ? JSON.stringify(v) : String(v);
  const box = document.getElementById('status'); box.replaceChildren();
  for (const [key, value] of Object.entries(rows)) {
    const row = box.insertRow(); row.insertCell().textContent = key; row.insertCell().textContent = text(value);
  }
}
async function ask() {
  try { const s = await (await fetch('state')).json(); draw(s); table(s); setTimeout(ask, 200); }
  catch (error) { document.title = 'companion replay (ended)'; }
}
ask();
</script></body></html>
"""
