"""`companion replay`: a recorded flight decided again."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
from rich.table import Table

from companion.commands.output_files import check_writable, write_json, writing
from companion.commands.progress import tracked_bytes, working
from companion.commands.terminal import Console, wide_console
from companion.config.file import load_config
from companion.config.schema import Config
from companion.errors import CompanionError, ConfigError
from companion.log.reader import Session, open_session, understood
from companion.log.truths import true_azimuths
from companion.replay.check import StreamCheck, check
from companion.replay.comparison import BearingRow, bearing_rows, iterations_of, mission_steps
from companion.replay.player import Player
from companion.replay.result import ReplayResult, replay_log, write_log

_file = click.Path(path_type=Path)
_LOG_NAME = "replay.mcap"
_WIDTH = 150

_SLOWEST = 1e-3


class _Speed(click.ParamType[float | None]):
    name = "X|max"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | None:
        if value in (None, "max"):
            return None
        try:
            speed = float(value)
        except ValueError:
            self.fail(f"{value}: expected a positive factor such as 1 or 20, or max", param, ctx)
        if not _SLOWEST <= speed <= 1 / _SLOWEST:
            self.fail(f"{value}: expected a positive factor such as 1 or 20, from 0.001 to 1000, or max", param, ctx)
        return speed


@click.command()
@click.argument("log", type=_file)
@click.option("--speed", type=_Speed(), default="max", show_default=True, help="Times real time.")
@click.option("--check", "is_check", is_flag=True, help="Compare with what was recorded; exit 1 where it differs.")
@click.option("--config", "config_path", type=_file, help="What another configuration would have made of the flight.")
@click.option("--live-page", is_flag=True, help="Show the replay in a browser, on a page of this machine.")
@click.option("--port", type=click.IntRange(0, 65535), default=8970, show_default=True, help="Of the page.")
@click.option("--json", "json_path", type=_file, help="Write the result here.")
@click.option("--out", type=_file, help="Folder for replay.mcap and, with --config, the plot comparison.png.")
def replay(
    log: Path,
    speed: float | None,
    is_check: bool,
    config_path: Path | None,
    live_page: bool,
    port: int,
    json_path: Path | None,
    out: Path | None,
) -> None:
    """Run the service's own code on a recorded flight. Nothing reaches a vehicle, a card or a network.

    LOG is a flight's log or any part of it. The same log gives the same bytes each time.
    """
    if is_check and config_path is not None:
        raise click.UsageError("--check asks for identity, --config for a difference: give one of them")
    session = open_session(log)
    check_writable(json_path, out)
    if out is not None and any(path.resolve() == (out / _LOG_NAME).resolve() for path in session.paths):
        raise CompanionError(f"{out / _LOG_NAME}: is the log that is replayed; choose another folder with --out")
    with understood(log):
        _replay(session, speed, is_check, config_path, live_page=live_page, port=port, json_path=json_path, out=out)


def _replay(
    session: Session,
    speed: float | None,
    is_check: bool,
    config_path: Path | None,
    *,
    live_page: bool,
    port: int,
    json_path: Path | None,
    out: Path | None,
) -> None:
    if session.metadata.get("role") == "recording":
        for name, is_given in (("--check", is_check), ("--config", config_path)):
            if is_given:
                raise click.UsageError(
                    f"{name}: {session.paths[0]} is an imported recording, which has no decisions to compare and no "
                    "mission; its replay gives its bearings (other estimators: companion log export, then analyze "
                    "--estimator)"
                )
        _replay_recording(session, json_path, out, port if live_page else None)
        return
    config = session.config() if config_path is None else _other_config(config_path)
    console = wide_console(_WIDTH)
    begun = time.monotonic()
    with Player(session, config, exact=config_path is None) as player:
        if live_page:
            from companion.replay.live_page import replay_with_page

            result = replay_with_page(player, session, speed, port, announce=_announce, stay=_stay)
        else:
            with tracked_bytes("replaying") as progress:
                result = replay_log(player, session, speed, progress)
    took_s = time.monotonic() - begun
    factor = result.flight_s / max(took_s, 1e-3)
    console.print(f"{result.flight_s:.1f} s of recording in {took_s:.1f} s: {factor:.0f} times real time")
    if result.is_cut:
        click.echo(
            f"the log is cut off or damaged: {result.flight_s:.1f} s can be replayed, up to its last whole event"
        )
    _conclude(session, config, result, (is_check, config_path, json_path, out), console=console)


def _announce(url: str) -> None:
    click.echo(f"the replay is at {url}")


def _stay() -> None:
    """On a terminal the page stays until its person has seen enough."""
    if sys.stdin.isatty() and sys.stdout.isatty():
        click.echo("the replay has ended; the page stays until Ctrl-C")
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()


def _other_config(path: Path) -> Config:
    config = load_config(path)
    if config.role != "uav":
        raise ConfigError(f"{path}: role: {config.role}; expected uav, the configuration of a robot that flies")
    return config


def _conclude(
    session: Session,
    config: Config,
    result: ReplayResult,
    options: tuple[bool, Path | None, Path | None, Path | None],
    *,
    console: Console,
) -> None:
    is_check, other, json_path, out = options
    content: dict[str, Any] = {"log": [path.name for path in session.paths], **result.as_json()}
    failed = ""
    if is_check:
        checks = check(result.recorded, result.decided, result.start_ns + session.wall_minus_mono_ns)
        console.print(_check_table(checks))
        content["check"] = [asdict(one) for one in checks]
        failed = _verdict(checks, result, session)
    rows: list[BearingRow] = []
    if other is not None:
        rows = _compare(session, config, result, console)
        content["comparison"] = [asdict(row) for row in rows]
    if out is not None:
        with writing(out):
            out.mkdir(parents=True, exist_ok=True)
            write_log(out / _LOG_NAME, session, config, result)
        if rows:
            from companion.pictures.comparison import draw_comparison

            with writing(out / "comparison.png"):
                draw_comparison(out / "comparison.png", rows, session.paths[0].name, str(other))
    if json_path is not None:
        write_json(json_path, content)
    if failed:
        raise CompanionError(failed)


def _verdict(checks: list[StreamCheck], result: ReplayResult, session: Session) -> str:
    differing = [one.topic for one in checks if one.difference is not None]
    if not differing and not result.unexpected:
        click.echo("identical within the tolerances of docs/replay.md")
        return ""
    dropped = result.dropped_while_recording
    why = f"; {dropped} messages were dropped while recording, so it cannot be exact" if dropped else ""
    return f"{session.paths[0]}: the replay differs in {', '.join(differing) or 'the commands it started'}{why}"


def _check_table(checks: list[StreamCheck]) -> Table:
    table = Table(title="recorded against replayed", title_justify="left")
    for name in ("stream", "recorded", "replayed", "same bytes"):
        table.add_column(name, justify="left" if name == "stream" else "right")
    table.add_column("first difference", overflow="fold")
    for one in checks:
        where = one.difference
        counts = (str(count) for count in (one.recorded, one.replayed, one.identical))
        table.add_row(one.topic, *counts, "none" if where is None else str(where))
    return table


def _compare(session: Session, config: Config, result: ReplayResult, console: Console) -> list[BearingRow]:
    start_ns = result.start_ns
    old, new = iterations_of(result.recorded), iterations_of(result.decided)
    rows = bearing_rows(old, new, start_ns, true_azimuths(session, config, [*old, *new]))
    table = Table(title="as flown, and as the other configuration would have had it", title_justify="left")
    for name in ("t [s]", "peer", "azimuth", "other", "moved", "reliability", "other", "error", "other"):
        table.add_column(name, justify="right")
    table.add_column("why not", overflow="fold")
    for row in rows:
        table.add_row(
            f"{row.t_s:.1f}", str(row.peer),
            _degrees(row.recorded_azimuth_deg), _degrees(row.replayed_azimuth_deg), _degrees(row.moved_deg),
            _share(row.recorded_reliability), _share(row.replayed_reliability),
            _degrees(row.recorded_error_deg), _degrees(row.replayed_error_deg), _why_not(row),
        )  # fmt: skip
    console.print(table)
    before, after = mission_steps(result.recorded, start_ns), mission_steps(result.decided, start_ns)
    for number, (a, b) in enumerate(zip(before, after, strict=False)):
        if a.text != b.text:
            console.print(f"mission: step {number} was {a.text} at {a.t_s:.2f} s, would be {b.text} at {b.t_s:.2f} s")
            break
    else:
        console.print(f"mission: {len(before)} steps as flown, {len(after)} with the other, the same in their order")
    console.print("The vehicle flew as recorded: after the first moved decision the other column is open loop.")
    return rows


def _replay_recording(session: Session, json_path: Path | None, out: Path | None, port: int | None) -> None:
    """An imported recording has no mission: its bearings are made again by the code of `companion analyze`. With a
    `port` a page shows them."""
    from companion.analysis.imported import analyze_session, path_of_recording
    from companion.analysis.summary import as_json, note_lines, problem_lines
    from companion.commands.tables import run_table

    with working("estimating"):
        result = analyze_session(session)
    console = wide_console(_WIDTH)
    console.print(run_table(result))
    for line in note_lines(result):
        console.print(f"  - {line}", markup=False, highlight=False, soft_wrap=True)
    for line in problem_lines(result):
        console.print(f"  ! {line}", markup=False, highlight=False, soft_wrap=True)
    if json_path is not None:
        write_json(json_path, as_json([result]))
    if out is not None:
        from companion.commands.recordings import draw_profiles

        draw_profiles(result, out)
    if port is not None:
        from companion.replay.recording_page import show_recording

        path_m = path_of_recording(session, result.kind)
        show_recording(result, path_m, session.paths[0].name, port, announce=_announce, stay=_stay)
    if not any(link.estimate is not None for link in result.links):
        raise CompanionError(f"{session.paths[0]}: no bearing; {'; '.join(problem_lines(result))}")


def _why_not(row: BearingRow) -> str:
    """Why a side has no bearing."""
    sides = (
        ("flown", row.recorded_azimuth_deg, row.recorded_refusal),
        ("other", row.replayed_azimuth_deg, row.replayed_refusal),
    )
    return "; ".join(f"{name}: {refusal or 'no such iteration'}" for name, azimuth, refusal in sides if azimuth is None)


def _degrees(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}°"


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
