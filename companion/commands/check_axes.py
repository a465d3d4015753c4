"""`companion check-axes`: moves by hand, live on the vehicle, that show whether the poses' axes are right."""

from __future__ import annotations

import asyncio
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from companion.commands.numbers import Number
from companion.commands.output_files import check_writable, write_json
from companion.config.file import load_config
from companion.core.messages import Pose
from companion.errors import CompanionError
from companion.host.control_socket import ask
from companion.pose.hand_moves import MOVES, HandMove, MoveResult, judge
from wsr.geometry import wrap_angle, yaw_of

_NORTH_DEG = 10.0


@click.command("check-axes")
@click.option("--config", "config_path", type=click.Path(path_type=Path), required=True, help="Of the running service.")
@click.option("--distance", type=Number(0.2, 5.0), default=1.0, show_default=True, help="Of each move [m].")
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the result here.")
def check_axes(config_path: Path, distance: float, json_path: Path | None) -> None:
    """Check the axes of the poses by moving the vehicle by hand.

    Take the propellers off. The service must run (it stays idle). For each move of the table it shows what East, North
    and Up did and what they should have done. Exit code 1 when one is wrong.
    """
    config = load_config(config_path)
    check_writable(json_path)
    control = config.path(config.control_socket)
    _pose(control)  # before a person starts to carry: is there a service, and has it poses?
    results = [_one(control, move, distance) for move in MOVES]
    north = _north(_pose(control))
    click.echo(north[1])
    if json_path is not None:
        rows = [asdict(result) for result in results]
        write_json(json_path, {"moves": rows, "north_error_deg": north[0]})
    wrong = [result.move.name for result in results if result.problem]
    wrong += ["north"] if north[0] is not None and abs(north[0]) > _NORTH_DEG else []
    if wrong:
        raise CompanionError(f"the axes are wrong: {', '.join(wrong)}; see docs/vehicle.md, Axes")


def _one(control: Path, move: HandMove, distance_m: float) -> MoveResult:
    click.prompt(f"{move.name}: hold it still, then press Enter", default="", show_default=False, prompt_suffix=" ")
    before = _pose_of(_pose(control))
    instruction = move.instruction.format(d=distance_m)
    click.prompt(f"  {instruction}; then press Enter", default="", show_default=False, prompt_suffix=" ")
    result = judge(move, before, _pose_of(_pose(control)), distance_m)
    seen = " ".join(f"{name} {value:+.2f}" for name, value in zip(("E", "N", "U"), result.moved_enu_m, strict=True))
    wanted = " ".join(
        f"{name} {value:+.2f}" for name, value in zip(("E", "N", "U"), result.expected_enu_m, strict=True)
    )
    turned = f", turned {math.degrees(result.turned_rad):+.0f} deg"
    click.echo(f"  moved {seen} m{turned}; expected {wanted} m: {result.problem or 'right'}")
    return result


def _pose(control: Path) -> dict[str, Any]:
    answer = asyncio.run(ask(control, "pose"))
    if not answer["ok"]:
        raise CompanionError(str(answer["error"]))
    return answer


def _pose_of(answer: dict[str, Any]) -> Pose:
    p, q, v = (tuple(answer[name]) for name in ("p_enu_m", "q_enu_from_body", "v_enu_m_s"))
    return Pose(
        t_mono_ns=answer["t_mono_ns"], p_enu_m=p, q_enu_from_body=q, v_enu_m_s=v, confidence=answer["confidence"]
    )


def _north(answer: dict[str, Any]) -> tuple[float | None, str]:
    """The angle between the autopilot's heading and the poses', and a line about it."""
    heading_rad = answer["autopilot_yaw_rad"]
    if heading_rad is None:
        return None, "north: no autopilot tells a heading; compare with a compass by hand"
    yaw_rad = float(yaw_of(answer["q_enu_from_body"]))
    error_deg = math.degrees(float(wrap_angle(yaw_rad - heading_rad)))
    verdict = "right" if abs(error_deg) <= _NORTH_DEG else f"more than {_NORTH_DEG:g}: set pose.north_yaw_deg anew"
    return error_deg, f"north: the poses' heading is {error_deg:+.1f} deg from the autopilot's: {verdict}"
