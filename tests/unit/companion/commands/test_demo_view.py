"""What a person reads at the end of a demo."""

from __future__ import annotations

import io
from dataclasses import replace

from rich.console import Console

from companion.commands.demo_view import rows_table, summary_lines
from companion.sim.demo_rows import DemoResult, Row

ROW = Row(
    iteration=3,
    time_s=12.3,
    packets=410,
    length_m=1.2,
    azimuth_deg=-91.0,
    true_azimuth_deg=-90.0,
    elevation_deg=-7.0,
    true_elevation_deg=-6.0,
    error_deg=1.4,
    crb_deg=0.21,
    reliability=0.9,
    distance_m=9.0,
    refusal="",
    uav_m=(0.0, 0.0, 1.5),
    beacon_m=(0.0, -9.0, 0.3),
)
REFUSED = replace(
    ROW, iteration=4, azimuth_deg=None, elevation_deg=None, error_deg=None, crb_deg=None, refusal="no packets [of it]"
)
RESULT = DemoResult(
    seed=1,
    reached=True,
    outcome="rendezvous at 1.9 m",
    transport="unix",
    flight_s=60.0,
    setup_s=3.0,
    closest_m=1.9,
    mean_error_deg=1.4,
    mean_setpoint_rate_hz=20.0,
    lowest_setpoint_rate_hz=19.0,
    setpoints_before_offboard=21,
    setpoints_after_offboard=0,
    rows=[ROW, REFUSED],
)


def test_units_and_angles_are_told() -> None:
    console = Console(file=io.StringIO(), width=140)
    console.print(rows_table(RESULT.rows))
    assert isinstance(console.file, io.StringIO)
    text = " ".join(console.file.getvalue().split())  # the title is wrapped to the table
    for told in ("[m, deg]", "elevation above the horizon", "azimuth from East", "[s]", "-91.0", "-7.0"):
        assert told in text


def test_the_mean_says_over_what_it_was_taken() -> None:
    lines = summary_lines(RESULT)
    assert any("1 of 2 SAR iterations" in line for line in lines)
    assert lines[-1] == "iteration 4 refused: no packets [of it]"
