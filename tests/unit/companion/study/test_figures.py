"""Parts of pictures: shares below a value, and lines over common x."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from companion.study.figures import draw_cdf, draw_lines


def test_what_is_infinite_never_comes_below() -> None:
    axes = Figure().subplots()
    draw_cdf(axes, {"some": [3.0, 1.0, math.inf, 2.0], "none": [math.inf], "nothing": []}, "error [deg]", (0, 10))
    some, none, nothing = axes.get_lines()
    assert np.asarray(some.get_xydata()).tolist() == [[1, 0], [1, 0.25], [2, 0.5], [3, 0.75]]
    assert (some.get_label(), none.get_label()) == ("some", "none: infinite everywhere")
    assert len(np.asarray(none.get_xdata())) == len(np.asarray(nothing.get_xdata())) == 0
    assert len({some.get_linestyle(), none.get_linestyle()}) == 2, "told apart without colour"
    assert axes.get_xlim() == (0, 10)


def test_groups_share_their_x_and_have_marks_of_their_own() -> None:
    axes = Figure().subplots()
    draw_lines(axes, [1, 2], {"a": [3.0, 4.0], "b": [5.0, math.nan]}, "packets", ylabel="error")
    first, second = axes.get_lines()
    assert np.asarray(first.get_xydata()).tolist() == [[1, 3], [2, 4]]
    assert first.get_marker() != second.get_marker()
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("packets", "error")
