"""`companion log`: what is done with logs after a flight."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path

import click
from rich.table import Table

from companion.commands.channel_option import known_channel
from companion.commands.moving_ends import moving_ends, with_moving_ends
from companion.commands.output_files import check_writable, new_folder, write_json, writing
from companion.commands.progress import tracked_bytes
from companion.commands.recordings import chosen_runs, lever_option, macs_by_name, run_options
from companion.commands.terminal import Console, wide_console
from companion.core.messages import Vector3
from companion.errors import CompanionError, escaped
from companion.log.info import LogInfo, inspect
from companion.log.reader import EMPTY, joined_line

_file = click.Path(path_type=Path, readable=False)
_WIDTH = 120


@click.group()
def log() -> None:
    """Flight logs: info, repair, export, merge, import. The format is described in docs/log.md."""


@log.command()
@click.argument("paths", nargs=-1, required=True, metavar="LOG...", type=_file)
@click.option("--json", "json_path", type=_file, help="Write the result here.")
def info(paths: tuple[Path, ...], json_path: Path | None) -> None:
    """What a log holds; also of one that was cut off."""
    console = wide_console(_WIDTH)
    infos = []
    check_writable(json_path)
    for path in paths:
        with tracked_bytes(f"reading {path.name}") as progress:
            infos.append(inspect(path, progress))
        _show(infos[-1], console)
    if json_path is not None:
        write_json(json_path, [_info_json(one) for one in infos])


@log.command()
@click.argument("path", metavar="LOG", type=_file)
@click.option("--out", type=_file, help="The whole log; else LOG.repaired.mcap.")
def repair(path: Path, out: Path | None) -> None:
    """Save what can be read of a log that was cut off, as a whole one. LOG itself is left as it is."""
    from companion.log.repair import repair as save

    target = out or path.with_name(f"{path.stem}.repaired{path.suffix}")
    with tracked_bytes("repairing") as progress:
        saved = save(path, target, progress)
    click.echo(f"{target}: {saved.messages} messages" + (" (it was whole already)" if saved.was_whole else ""))
    if saved.damaged:
        lost = f"{saved.damaged} damaged places left out, {saved.lost_bytes / 1e3:.1f} kB of the file"
        click.echo(f"{lost}: a replay of it will differ from there on", err=True)
    if not saved.is_replayable:
        click.echo("its configuration and its clock are lost: it cannot be replayed", err=True)


@log.command()
@click.argument("path", metavar="LOG", type=_file)
@click.option("--to", "formats", multiple=True, type=click.Choice(["tum", "csv", "dat", "npz"]), help="Else all.")
@click.option("--ros2", is_flag=True, help="A rosbag2 folder (MCAP) of standard messages; alone unless --to is given.")
@click.option("--out", type=_file, default=Path("export"), show_default=True, help="Folder for the files.")
def export(path: Path, formats: tuple[str, ...], ros2: bool, out: Path) -> None:
    """TUM trajectories, CSV tables, CSI logs (.dat, .csi of an AX card), NumPy arrays. An imported run gives its files
    back."""
    from companion.analysis.imported import export as write
    from companion.log.export import FORMATS, ROS2
    from companion.log.reader import open_session, understood

    session = open_session(path)
    wanted = (*formats, ROS2) if ros2 else formats or FORMATS
    cut = dict[Path, None]()
    with new_folder(out), writing(out), understood(path), tracked_bytes("exporting") as progress:
        written = write(session, wanted, out, progress, on_cut=lambda part: cut.update({part: None}))
    for part in cut:
        click.echo(f"{part}: cut off or damaged; what can be read of it is exported", err=True)
    if not written:
        raise CompanionError(f"{path}: holds nothing that {', '.join(wanted)} could show")
    click.echo("written: " + ", ".join(map(str, written)))


@log.command()
@click.argument("first", metavar="LOG", type=_file)
@click.argument("others", nargs=-1, metavar="[OTHER]...", type=_file)
@click.option("--ulg", type=_file, help="PX4's own log of the flight.")
@click.option("--out", type=_file, required=True, help="The merged log.")
def merge(first: Path, others: tuple[Path, ...], ulg: Path | None, out: Path) -> None:
    """Logs of one flight as one, on the time of the first: of beacons, of a simulator's truth, of PX4."""
    from companion.log.merge import merge as join
    from companion.log.reader import understood

    if not others and ulg is None:
        raise click.UsageError("one log alone needs no merging: give others, or --ulg")
    with understood(first), tracked_bytes("merging") as progress:
        joined = join(first, others, ulg, out, progress)
    for one in joined:
        click.echo(f"{one.path}: {one.offset_s:+.4f} s, {one.how}; topics {one.prefix or 'as they are'}")
    click.echo(f"written: {out}")


@log.command("import")
@click.argument("run", required=False, metavar="[RUN]", type=_file)
@run_options
@click.option("--channel", type=int, callback=known_channel, help="WiFi channel; else as the ground truth file says.")
@click.option("--mac", "macs", multiple=True, metavar="NAME=MAC", help="Card of a transmitter that is not known.")
@lever_option
@moving_ends
@click.option("--out", type=_file, default=Path("imported"), show_default=True, help="Folder for <set>_<TS>.mcap.")
def import_(
    run: Path | None,
    stamps: tuple[str, ...],
    rx: Path | None,
    tx: tuple[Path, ...],
    traj: Path | None,
    channel: int | None,
    macs: tuple[str, ...],
    lever: Vector3 | None,
    time_offset: float,
    tx_traj: tuple[str, ...],
    tx_time_offset: tuple[str, ...],
    tx_lever: tuple[str, ...],
    out: Path,
) -> None:
    """Recorded runs as logs: a folder of the WSR data sets, or loose .dat files with a trajectory."""
    from companion.analysis.imported import import_run
    from companion.analysis.result import Options

    runs = chosen_runs(() if run is None else (run,), stamps, rx, tx, traj=traj, kind=None)
    options = Options(kind=None, channel=channel, lever_m=lever)
    runs, options = with_moving_ends(
        runs, options, time_offset, tx_traj, tx_time_offset=tx_time_offset, tx_lever=tx_lever
    )
    failed = []
    begun = time.monotonic()
    with tracked_bytes("importing") as progress:
        check_writable(None, out)
        for number, one in enumerate(runs):
            target = out / f"{one.set_name}_{one.folder.resolve().name}_{one.stamp}.mcap"
            try:
                scene = import_run(one, target, replace(options, macs=macs_by_name(macs, one)))
            except CompanionError as error:
                failed.append(str(error))
                continue
            for path in (*one.trajectories.values(), *one.tx_trajectories.values()):
                click.echo(f"  - trajectory {path}")
            for problem in scene.problems:
                click.echo(f"  ! {problem}", err=True)
            progress(number + 1, len(runs))
    for text in failed:
        click.echo(f"companion: {text}", err=True)
    click.echo(f"{len(runs) - len(failed)} of {len(runs)} runs in {out} after {time.monotonic() - begun:.1f} s")
    if len(failed) == len(runs):
        raise CompanionError("nothing could be imported")


def _show(one: LogInfo, console: Console) -> None:
    broken = f"DAMAGED at {one.damaged} places" if one.damaged else "CUT OFF"
    state = "whole" if one.is_whole else f"{broken} (companion log repair saves what can be read)"
    if one.size_bytes == 0:
        state = EMPTY
    elif one.another_at is not None:
        state = joined_line(one.another_at)
    meta = one.metadata
    console.print(f"{one.path}: {one.size_bytes / 1e6:.2f} MB, {one.duration_s:.1f} s, {state}", highlight=False)
    about = [f"{key} {meta[key]}" for key in ("role", "name", "version", "session", "part") if key in meta]
    console.print(", ".join(about) + (f", {one.dropped} messages dropped" if one.dropped else ""), highlight=False)
    table = Table(show_edge=False)
    for name in ("topic", "encoding", "schema"):
        table.add_column(name)
    for name in ("messages", "per second", "kB"):
        table.add_column(name, justify="right")
    for topic in one.topics:
        rate, size = f"{topic.rate_hz:.1f}", f"{topic.payload_bytes / 1e3:.1f}"
        told = (" ".join(escaped(text).split()) for text in (topic.topic, topic.encoding, topic.schema))
        table.add_row(*told, str(topic.messages), rate, size)
    console.print(table)


def _info_json(one: LogInfo) -> dict[str, object]:
    return {
        "path": str(one.path),
        "size_bytes": one.size_bytes,
        "is_whole": one.is_whole,
        "damaged": one.damaged,
        "another_at": one.another_at,
        "duration_s": one.duration_s,
        "dropped": one.dropped,
        "metadata": dict(one.metadata),
        "topics": [asdict(topic) | {"rate_hz": topic.rate_hz} for topic in one.topics],
    }
