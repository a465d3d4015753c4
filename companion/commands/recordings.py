"""What the commands on recorded runs share: the options that choose runs, MACs by name, pictures of profiles."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from companion.analysis.result import RunResult
from companion.analysis.runs import KNOWN_TRANSMITTERS, RecordingError, Run, find_runs, loose_run
from companion.analysis.trajectories import PoseKind
from companion.commands.numbers import lever_m
from companion.commands.output_files import writing
from companion.core.messages import Vector3

_Command = TypeVar("_Command", bound=Callable[..., Any])

_file = click.Path(path_type=Path)


def run_options(command: _Command) -> _Command:
    """--run of a folder, or loose files: the arguments `stamps`, `rx`, `tx` and `traj` of `chosen_runs`."""
    for option in reversed(
        (
            click.option("--run", "stamps", multiple=True, metavar="TS", help="Only the runs of this time stamp."),
            click.option("--rx", type=_file, help="CSI log of the receiving robot (loose files)."),
            click.option("--tx", type=_file, multiple=True, help="CSI log of a transmitter (loose files)."),
            click.option("--traj", type=_file, help="Trajectory of the receiving robot (loose files)."),
        )
    ):
        command = option(command)
    return command


def _near(_: click.Context, __: click.Parameter, lever: Vector3 | None) -> Vector3 | None:
    return None if lever is None else lever_m(f"--lever {' '.join(map(str, lever))}", lever)


lever_option = click.option(
    "--lever",
    type=(float, float, float),
    metavar="F L U",
    callback=_near,
    help="Antenna seen from the tracked point, in metres forward, left, up; else that of the WSR robot.",
)


def chosen_runs(
    folders: tuple[Path, ...],
    stamps: tuple[str, ...],
    rx: Path | None,
    tx: tuple[Path, ...],
    *,
    traj: Path | None,
    kind: PoseKind | None,
) -> list[Run]:
    """Those of the folders, or the one of loose files. Raises UsageError, and RecordingError where there are none."""
    if rx is None and not tx and traj is None:
        if not folders:
            raise click.UsageError("give a RUN folder, or loose files with --rx, --tx and --traj")
        runs = [run for folder in folders for run in find_runs(folder)]
        found = list({(run.folder.resolve(), run.stamp): run for run in runs}.values())
        chosen = [run for run in found if not stamps or run.stamp in stamps]
        missing = sorted(set(stamps) - {run.stamp for run in found})
        if missing:
            listed = ", ".join(sorted({run.stamp for run in found})[:10])
            raise RecordingError(f"no run {', '.join(missing)} in {', '.join(map(str, folders))}; there are: {listed}")
        return chosen
    if folders or stamps:
        raise click.UsageError("--rx, --tx and --traj do not go together with RUN folders and --run")
    if rx is None or not tx or traj is None:
        raise click.UsageError("loose files need all of --rx, --tx and --traj")
    return [loose_run(rx, tx, traj, kind)]


def macs_by_name(macs: tuple[str, ...], run: Run) -> dict[str, str]:
    """MAC by transmitter name. Raises UsageError for a MAC that cannot be told to belong to a file, or not to it."""
    names: dict[str, str] = {}
    unnamed = [name for name in run.tx if not any(given.startswith(f"{name}=") for given in macs)]
    for given in macs:
        name, _, mac = given.rpartition("=")
        mac = mac.upper().replace("-", ":")
        if len(mac.split(":")) != 6 or any(len(byte) != 2 or not _is_hex(byte) for byte in mac.split(":")):
            raise click.UsageError(f"--mac {given}: expected six bytes such as 00:21:6A:3F:17:5A, or NAME=MAC")
        if not name:
            name = KNOWN_TRANSMITTERS.get(mac, "")
            # A file of another known card stays what it is.
            if name not in run.tx and len(unnamed) == 1 and not (name and unnamed[0] in KNOWN_TRANSMITTERS.values()):
                name = unnamed[0]
            if not name:
                raise click.UsageError(f"--mac {mac}: whose? Write NAME={mac} with NAME one of {', '.join(run.tx)}")
        owner = KNOWN_TRANSMITTERS.get(mac)
        if owner not in (None, name) and name in KNOWN_TRANSMITTERS.values():
            raise click.UsageError(f"--mac {given}: {mac} is the card of {owner}, not of {name}")
        if name in names:
            raise click.UsageError(f"--mac {given}: {name} has already been given {names[name]}")
        names[name] = mac
    return names


def draw_profiles(result: RunResult, out: Path) -> None:
    """A picture of the profile of each link that has one."""
    # Imported late: it takes half a second, and --no-pictures does without.
    from companion.pictures.profile import draw_profile

    for link in result.links:
        if link.estimate is None or link.profile is None:
            continue
        run, truth = result.run, link.truth
        path = out / f"{run.set_name}_{run.stamp}_{link.name}_{result.kind}.png"
        bearing = (truth.azimuth_rad, truth.polar_rad) if truth else None
        azimuth, polar = link.estimate.azimuth_observable, link.estimate.polar_observable
        seen = {"azimuth": azimuth, "polar angle": polar}
        unseen = " and ".join(name for name, is_seen in seen.items() if not is_seen)
        flat = f"  {unseen} not observable on this path" if unseen else ""
        title = f"{run.title}  {link.name}  ({result.kind}){flat}"
        with writing(path):
            draw_profile(
                path, link.profile, link.estimate, bearing,
                title=title, azimuth_observable=azimuth, polar_observable=polar,
            )  # fmt: skip


def _is_hex(byte: str) -> bool:
    return all(digit in "0123456789ABCDEF" for digit in byte)
