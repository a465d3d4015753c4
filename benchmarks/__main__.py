"""`python -m benchmarks`: everything that is measured, as ratios against a baseline of the same run."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

from benchmarks.estimates import EstimateTimes, estimate_times, worker_memory_mb
from benchmarks.idle import IdleCost, idle_cost
from benchmarks.informativeness import InformativenessTimes, informativeness_times
from benchmarks.intake import crowd, crowds, line, plot, throughput
from benchmarks.page import PageCost, page_cost
from benchmarks.profiles import ProfileRow, atom_profile_s, grid_times_s, profile_rows
from benchmarks.recorder import RecorderCost, recorder_cost, replay_factor

COUNTS = (400, 880, 2000, 5000)
GRID_ROWS = (30, 60, 90, 180, 360)
_GRID_PACKETS = 880
_ATOM_PACKETS = 2000
_WIDE_ROBOTS = 4
_GOLDEN = Path(__file__).resolve().parents[1] / "tests" / "golden" / "approach.mcap"


@click.command()
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the figures here.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the plot.")
@click.option("--memory-iterations", type=click.IntRange(min=1), default=1000, show_default=True)
@click.option("--intake-seconds", type=click.FloatRange(min=1), default=60.0, show_default=True)
@click.option("--curve-seconds", type=click.FloatRange(min=1), default=5.0, show_default=True)
@click.option("--intake-only", is_flag=True, help="Only the radio's way in.")
def main(
    json_path: Path | None,
    out: Path | None,
    memory_iterations: int,
    intake_seconds: float,
    curve_seconds: float,
    intake_only: bool,
) -> None:
    """Times are the best of several runs, of one thread; compare ratios, not seconds, between machines."""
    speed, heard = throughput(), []
    click.echo(
        f"CSI from file: {speed.batch_per_s / 1e3:.0f} k records/s; live path: {speed.live_us:.1f} us a record, "
        f"{speed.datagram_us:.0f} us a neighbour's datagram"
    )
    click.echo(f"live path of an AX card at 80 MHz, two chains: {speed.live_80mhz_us:.0f} us a record")
    wide = crowd(_WIDE_ROBOTS, curve_seconds, at_80mhz=True)
    click.echo(line(wide, "robots with AX cards at 80 MHz"))
    for one in crowds(intake_seconds, curve_seconds):
        click.echo(line(one))
        heard.append(one)
    intake = {**asdict(speed), "crowd_80mhz": asdict(wide), "crowds": [asdict(one) for one in heard]}
    if out is not None:
        plot(heard[1:], out)
    if intake_only:
        if json_path is not None:
            json_path.write_text(json.dumps({"intake": intake}, indent=2) + "\n")
        return
    # Processor time is what is measured: that of one thread.
    threadpool_limits(1)
    rows = profile_rows(COUNTS)
    _print_profiles(rows)
    grids = grid_times_s(_GRID_PACKETS, GRID_ROWS)
    sizes = ", ".join(f"{2 * size} x {size}: {1e3 * seconds:.2f} ms" for size, seconds in grids.items())
    click.echo(f"far-field profile of {_GRID_PACKETS} packets on other grids: {sizes}")
    atom_s = atom_profile_s(_ATOM_PACKETS)
    naive_s = next(row.naive_s for row in rows if row.packets == _ATOM_PACKETS)
    click.echo(
        f"compiled for an Atom (goldmont), {_ATOM_PACKETS} packets: {1e3 * atom_s:.1f} ms, {naive_s / atom_s:.0f} x"
    )
    times = estimate_times()
    _print_estimates(times)
    told = informativeness_times()
    _print_informativeness(told)
    recording = recorder_cost()
    factor = replay_factor(_GOLDEN)
    _print_recording(recording, factor)
    shown = page_cost()
    _print_page(shown)
    idle = idle_cost()
    _print_idle(idle)
    memory = list(worker_memory_mb(memory_iterations, max(1, memory_iterations // 10)))
    click.echo("worker memory [MB]: " + ", ".join(f"{mb:.0f} after {number}" for number, mb in memory))
    if json_path is not None:
        figures = {"profiles": [asdict(row) for row in rows], "atom_s": atom_s, "estimates": asdict(times)}
        figures |= {"grids_s": grids}
        figures |= {"informativeness": asdict(told), "intake": intake, "memory_mb": memory}
        figures |= {
            "recording": asdict(recording),
            "replay_factor": factor,
            "page": asdict(shown),
            "idle": asdict(idle),
        }
        json_path.write_text(json.dumps(figures, indent=2) + "\n")
    if out is not None:
        _plot(rows, grids, times, out)


def _print_profiles(rows: list[ProfileRow]) -> None:
    click.echo("360 x 180 far-field profile; 32 more packets in a sliding window, and its profile read too [ms]")
    click.echo(
        f"{'packets':>8} {'naive':>9} {'gemm':>8} {'direct':>8} {'members':>8} {'ours':>8} {'naive/ours':>11} "
        f"{'bound':>7} {'+32':>7} {'read':>7}"
    )
    for row in rows:
        click.echo(
            f"{row.packets:>8} {1e3 * row.naive_s:>9.0f} {1e3 * row.gemm_s:>8.1f} {1e3 * row.direct_s:>8.2f} "
            f"{row.members:>8} {1e3 * row.ours_s:>8.2f} {row.naive_s / row.ours_s:>11.0f} {1e3 * row.bound_s:>7.2f} "
            f"{1e3 * row.batch_s:>7.2f} {1e3 * row.batch_read_s:>7.2f}"
        )


def _print_estimates(times: EstimateTimes) -> None:
    click.echo(
        f"robust estimate, 880 packets x 30 subcarriers: {1e3 * times.robust_3d_s:.0f} ms in 3D, "
        f"{times.robust_3d_s / times.far_field_profile_s:.1f} x the far-field profile; planar "
        f"{1e3 * times.robust_planar_s:.1f} ms, {times.robust_planar_s / times.robust_3d_s:.3f} of it"
    )
    links = ", ".join(f"{count}: {1e3 * seconds:.0f} ms" for count, seconds in times.links_s.items())
    click.echo(f"transmitters in one iteration: {links}")
    widths = ", ".join(f"{width} MHz {1e3 * seconds:.0f} ms" for width, seconds in times.ax_s.items())
    click.echo(
        f"robust estimate of an AX card's packets: {widths}; {times.ax_s[80] / times.ax_s[20]:.2f} x from 20 to 80"
    )


def _print_informativeness(times: InformativenessTimes) -> None:
    click.echo(
        f"informativeness, 880 packets: one direction {1e3 * times.one_direction_s:.2f} ms, worst case over 5 degrees "
        f"{1e3 * times.worst_case_s:.2f} ms, all of a SAR iteration {1e3 * times.iteration_s:.2f} ms; 64800 directions "
        f"{1e3 * times.sphere_s:.0f} ms, {times.scalar_s / times.sphere_s:.0f} x faster than one by one"
    )


def _print_recording(cost: RecorderCost, factor: float) -> None:
    shares = f"{100 * cost.writer_share:.1f} the writer's thread, {100 * cost.calls_share:.1f} the calls"
    click.echo(
        f"recording at full rate: {100 * cost.core_share:.1f} % of a core ({shares}), {cost.messages_per_s:.0f} "
        f"messages/s, {cost.kilobytes_per_s:.0f} kB/s, longest call {cost.longest_record_us:.0f} us, "
        f"{cost.dropped} dropped"
    )
    click.echo(f"replay of the golden log: {factor:.0f} times real time")


def _print_page(cost: PageCost) -> None:
    shares = f"{100 * cost.process_share:.1f} its process, {100 * cost.feed_share:.1f} the service's thread"
    click.echo(
        f"page with one viewer: {100 * (cost.process_share + cost.feed_share + cost.calls_share):.1f} % of a core "
        f"({shares}, {100 * cost.calls_share:.1f} the calls), {cost.pictures / cost.seconds:.1f} pictures/s, "
        f"{cost.kilobytes_per_s:.0f} kB/s, {cost.process_mb:.0f} MB, {cost.dropped} dropped"
    )


def _print_idle(cost: IdleCost) -> None:
    each = ", ".join(
        f"{one.name} {one.resident_mb:.0f} MB {100 * one.share:.1f} % {one.wakes_per_s:.0f} wakes/s, "
        f"{one.loop_wakes_per_s:.0f} of its loop"
        for one in cost.processes
    )
    click.echo(
        f"idle, {cost.csi_per_s:.0f} packets and {cost.poses_per_s:.0f} poses/s: {cost.memory_mb:.0f} MB and "
        f"{100 * cost.share:.1f} % of a core without the worker ({each}); ready after {cost.start_s:.1f} s "
        f"({cost.start_processor_s:.1f} of the processor), stopped after {cost.stop_s:.2f} s, its log "
        f"{'whole' if cost.log_is_whole else 'CUT OFF'}; an empty wake costs {cost.empty_wake_us:.0f} us here"
    )


def _plot(rows: list[ProfileRow], grids: dict[int, float], times: EstimateTimes, out: Path) -> None:
    figure = Figure(figsize=(12, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    left, middle, right = figure.subplots(1, 3)
    packets = [row.packets for row in rows]
    named = {"naive_s": "naive", "gemm_s": "GEMM", "direct_s": "direct", "ours_s": "by skeletons"}
    named |= {"bound_s": "bound: arithmetic alone", "batch_s": "32 more packets"}
    for (name, label), style in zip(named.items(), ("k--o", "k:s", "k--^", "k-o", "k:", "k-.^"), strict=True):
        left.loglog(packets, [1e3 * getattr(row, name) for row in rows], style, label=label)
    left.set(xlabel="packets", ylabel="time [ms]", title="far-field profile, 360 x 180")
    left.set_xticks(packets, [str(count) for count in packets])
    left.minorticks_off()
    left.set_ylim(top=50.0 * left.get_ylim()[1])
    left.legend(ncols=2, fontsize="small", loc="upper left")
    directions = [2 * size * size for size in grids]
    middle.loglog(directions, [1e3 * seconds for seconds in grids.values()], "k-o")
    middle.set(xlabel="directions", ylabel="time [ms]", title=f"far-field profile, {_GRID_PACKETS} packets")
    counts = np.array(list(times.links_s))
    right.plot(counts, 1e3 * np.array(list(times.links_s.values())), "k-o")
    right.set(xlabel="transmitters", ylabel="time [ms]", title="robust estimates of one iteration", ylim=(0, None))
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "performance.png", dpi=120)


if __name__ == "__main__":
    main()
