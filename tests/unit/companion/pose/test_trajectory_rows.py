"""Rows that are of two bodies, there twice, or no numbers of a trajectory at all are told by line and column."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from companion.pose.trajectory_columns import TrajectoryError
from companion.pose.trajectory_file import read_trajectory_file
from tests.unit.companion.pose.written_way import ROWS, Row, numbers, same, written


def _refusal(path: Path) -> str:
    with pytest.raises(TrajectoryError) as told:
        read_trajectory_file(path)
    assert str(told.value).startswith(f"{path}: ") and "\n" not in str(told.value)
    return str(told.value)


@pytest.mark.parametrize("head", ["topic", "name", "Body", "rigid_body_id", "header.frame_id", "id"])
def test_rows_of_two_bodies_are_refused_by_the_column_that_tells_them_apart(tmp_path: Path, head: str) -> None:
    """A hand's breadth apart, and by turns, they look like one robot that shakes."""

    def line(row: Row) -> str:
        return f"{numbers(row, 'txyz')},{'ab'[ROWS.index(row) % 2]}"

    told = _refusal(written(tmp_path, line, f"t,x,y,z,{head}\n"))
    assert f"line 4 is of {head} a again, after b in line 3: rows of several are mixed; expected those of one" in told


@pytest.mark.parametrize(
    ("head", "value"),
    [
        ("id", lambda n: str(n // 2)),
        ("name", lambda n: "" if n % 2 else "drone"),
        ("id", lambda n: str(n % 256)),
        ("frame_id", lambda n: "map" if n < 10 else "odom"),
        ("status", lambda n: "ab"[n % 2]),
    ],
)
def test_numbers_of_rows_and_what_is_left_out_now_and_then_mix_nothing(
    tmp_path: Path, head: str, value: Callable[[int], str]
) -> None:
    path = written(tmp_path, lambda row: f"{value(ROWS.index(row))},{numbers(row, 'txyz')}", f"{head},t,x,y,z\n")
    same(read_trajectory_file(path), False)


def test_numbers_of_frames_may_begin_again(tmp_path: Path) -> None:
    rows = "".join(f"{n / 100:.2f},{n / 300:.6f},0,0,{n % 64}\n" for n in range(200))
    (tmp_path / "way.csv").write_text("t,x,y,z,id\n" + rows)
    assert len(read_trajectory_file(tmp_path / "way.csv").t_s) == 200


def test_rows_that_are_there_twice_are_said_to_be(tmp_path: Path) -> None:
    twice = written(tmp_path, lambda row: "\n".join([numbers(row, "txyz")] * 2), "t,x,y,z\n")
    assert "line 3 is line 2 again, and so are 30 of 60 rows; expected each once" in _refusal(twice)
    path = written(tmp_path, lambda row: numbers(row, "txyzabcd", " "))
    path.write_text(path.read_text() * 2)
    assert "from line 31 on all rows are there again; expected each once" in _refusal(path)


def test_rows_of_nan_are_not_each_other_again(tmp_path: Path) -> None:
    path = written(tmp_path, lambda row: numbers(row, "txyzabcd", " ") + "\nnan" + " nan" * 7)
    same(read_trajectory_file(path), True)
    path = written(tmp_path, lambda _: "nan" + " nan" * 7)
    assert "no finite poses" in _refusal(path)


@pytest.mark.parametrize("units", ["s,mm,mm,mm", "[s],[m],[m],[m]", "sec,m,m,-"])
def test_a_row_of_units_belongs_into_the_headings(tmp_path: Path, units: str) -> None:
    told = _refusal(written(tmp_path, lambda row: numbers(row, "tXWZ"), f"t,x,y,z\n{units}\n"))
    assert f"line 2 is a row of units ({units.replace(',', ', ')}); expected them in headings such as `x [mm]`" in told


@pytest.mark.parametrize("time", ["2023-11-14T22:13:21.25", "2023-11-14 22:13:21Z", "22:13:21.25"])
def test_a_date_is_no_number_of_seconds(tmp_path: Path, time: str) -> None:
    told = _refusal(written(tmp_path, lambda row: f"{time},{numbers(row, 'xyz')}", "time,x,y,z\n"))
    assert f"line 2 is no row of numbers: time is '{time}'; expected seconds, no date or time of day" in told


@pytest.mark.parametrize("separator", [" ", "\t", ";"])
@pytest.mark.parametrize("head", [False, True])
def test_decimal_commas_are_said_whatever_separates(tmp_path: Path, separator: str, head: bool) -> None:
    first = separator.join(["t", "x", "y", "z", "qx", "qy", "qz", "qw"]) + "\n" if head else ""
    path = written(tmp_path, lambda row: numbers(row, "txyzabcd", separator).replace(".", ","), first)
    told = _refusal(path)
    assert f"line {1 + head}" in told and ("decimal points" in told or "expected a decimal point" in told)


@pytest.mark.parametrize("separator", [",", ", ", ";", "; ", " ", "\t"])
@pytest.mark.parametrize("whole", [True, False])
def test_decimal_commas_beside_whole_numbers_are_said_too(tmp_path: Path, separator: str, whole: bool) -> None:
    path, zero = tmp_path / "way.csv", "0" if whole else "0,000"
    rows = [[f"{number},5", "1,05", zero, "1,5", "0", "0", "0", "1"] for number in range(20)]
    path.write_text("".join(separator.join(row) + "\n" for row in rows))
    with pytest.raises(TrajectoryError, match="decimal comma"):
        read_trajectory_file(path)


def test_a_nanosecond_may_begin_with_a_nought(tmp_path: Path) -> None:
    path = tmp_path / "way.csv"
    stamps = [divmod(number * 100_000_000 + 50, 1_000_000_000) for number in range(20)]
    path.write_text("".join(f"{sec},{nsec:09d},1.5,0,{nsec / 1e9}\n" for sec, nsec in stamps))
    assert read_trajectory_file(path).t_s[1] == pytest.approx(0.10000005, abs=1e-12)
