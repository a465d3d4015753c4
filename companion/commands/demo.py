"""`companion demo`: a full simulated rendezvous over real interfaces."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

import click
import numpy as np
from click.core import ParameterSource

from companion.commands.demo_view import LiveTable, rows_table, summary_lines
from companion.commands.numbers import Number
from companion.commands.output_files import PICTURE, check_writable, write_json
from companion.commands.terminal import Console, wide_console
from companion.errors import CompanionError
from companion.sensing.worker import is_compiled
from companion.sensing.worker_process import compile_kernel
from companion.sim.demo import DemoRun, refuse_flown, run_demo
from companion.sim.demo_rows import DemoResult, summarise
from companion.sim.sample import write_sample
from companion.sim.scenes import SCENES
from companion.sim.stage import Card

_PIPE_WIDTH = 140


@click.command()
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Seed of the simulated world.")
@click.option("--max-time", type=Number(1, 86400), default=240.0, show_default=True, help="Limit after engaging [s].")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("demo-out"),
    show_default=True,
    help="Directory for the log, the pictures and the logs of the processes.",
)
@click.option(
    "--scene", type=click.Choice(SCENES), help="A named room and what happens in it.  [default: a plain room]"
)
@click.option("--gps", is_flag=True, help="The vehicle has GPS; without this it flies by the service's poses.")
@click.option("--json", "json_path", type=click.Path(dir_okay=False, path_type=Path), help="Write the result here.")
@click.option(
    "--recording",
    type=click.Path(file_okay=False, path_type=Path),
    help="Fly nothing: write a simulated recording into this folder, to try `companion analyze` on.",
)
@click.option(
    "--card",
    type=click.Choice(["5300", "ax210"]),
    default="5300",
    show_default=True,
    help="Card of both robots; an ax210's packets are 80 MHz wide, without frame counters.",
)
def demo(
    seed: int,
    max_time: float,
    out: Path,
    scene: str | None,
    gps: bool,
    json_path: Path | None,
    recording: Path | None,
    card: Card,
) -> None:
    """A drone finds a ground robot: real MAVLink, UDP, netlink and processes; simulated card, camera and vehicle.

    Exit code 0 only when the drone came within 2 m of the robot.
    """
    if recording is not None:
        _refuse_of_a_flight("max_time", "out", "scene", "gps", "json_path")
        azimuth_deg, elevation_deg = write_sample(recording, seed, 80 if card == "ax210" else None)
        where = f"azimuth {azimuth_deg:.1f}, elevation {elevation_deg:.1f} deg"
        click.echo(f"{recording}: the transmitter tx2 is at {where}")
        click.echo(f"now: companion analyze {recording}")
        return
    check_writable(json_path, out)
    check_writable(out / "flight.png", kind=PICTURE)
    refuse_flown(out)
    if json_path is not None and json_path.is_file():
        json_path.unlink()  # the result of an earlier run must not pass for one of this
    console = wide_console(_PIPE_WIDTH)
    if not is_compiled():
        console.print("compiling the AOA kernel, this once: half a minute, or some on a slow computer", highlight=False)
        asyncio.run(compile_kernel("robust"))
    with LiveTable(console) as table:
        try:
            run = asyncio.run(run_demo(seed, out, max_time, table.show, gps=gps, scene=scene, card=card))
        except asyncio.CancelledError:
            raise CompanionError("ended by a signal") from None
    result = _report(run, out, console)
    if json_path is not None:
        write_json(json_path, result)
    if not result.reached:
        raise CompanionError(f"seed {seed}: {result.outcome}")


def _report(run: DemoRun, out: Path, console: Console) -> DemoResult:
    from companion.pictures.flight import Arrow, draw_flight
    from companion.pictures.profile import draw_profile

    result, profile, last = summarise(run, out / "log.mcap")
    console.print(rows_table(result.rows))
    for line in summary_lines(result):
        console.print(line, highlight=False)
    written = [out / "log.mcap"]
    if run.truths:
        bearings = [
            Arrow(row.iteration, *row.uav_m[:2], math.radians(row.azimuth_deg))
            for row in result.rows
            if row.azimuth_deg is not None
        ]
        draw_flight(
            out / "flight.png",
            np.array([t.uav_antenna_enu_m for t in run.truths]),
            np.array([t.beacon_antenna_enu_m for t in run.truths]),
            bearings,
            title=f"The flight from above, seed {result.seed}: {result.outcome}",
        )
        written.append(out / "flight.png")
    if profile is not None and last is not None and last.estimate is not None:
        row = next((row for row in result.rows if row.iteration == last.number), None)
        truth = None
        if row is not None:
            truth = (math.radians(row.true_azimuth_deg), math.radians(90.0 - row.true_elevation_deg))
        draw_profile(
            out / "profile.png", profile, last.estimate, truth, title=f"AOA profile of SAR iteration {last.number}"
        )
        written.append(out / "profile.png")
    console.print("transport of CSI: " + _transport(run), highlight=False)
    console.print("written: " + ", ".join(map(str, written)), highlight=False)
    return result


def _transport(run: DemoRun) -> str:
    if run.stage.transport == "netlink":
        return "the kernel's netlink connector"
    if run.stage.transport == "nl80211":
        return "vendor events over the kernel's generic netlink"
    return f"a Unix datagram socket, because {run.stage.transport_reason}"


def _refuse_of_a_flight(*names: str) -> None:
    """Raises UsageError for the first of the parameters `names` that stands on the command line beside --recording."""
    context = click.get_current_context()
    options = {parameter.name: parameter.opts[-1] for parameter in context.command.params}
    for name in names:
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{options[name]} does not go together with --recording, which flies nothing")
