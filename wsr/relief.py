"""Prominence and width of the peaks of a profile: how far one must come down from them, and how wide they stand."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from wsr.machine_code import compiled

_LEVELS = 8192

Array32 = NDArray[np.float32]
Indices = NDArray[np.int64]


def prominences(power: Array32) -> Array32:
    """For each cell (T, P) that is a peak, its height over the highest saddle that leads to higher ground; else 0.

    The grid is a sphere, as in `wsr.peaks`; with one row (T = 1) it is a circle. The highest peak has all its height
    over the lowest cell. Heights are resolved to 1 part in 8192.
    """
    top, bottom = float(power.max()), float(power.min())
    if not top > bottom:
        return np.zeros_like(power)
    level = ((top - power) * ((_LEVELS - 1) / (top - bottom))).astype(np.uint16)
    order = np.argsort(level, axis=None, kind="stable")
    height = np.ascontiguousarray(power, np.float32).ravel()
    parent, result = np.full(height.size, -1), np.zeros(height.size, np.float32)
    _flood(height, order, _beside(*power.shape), parent, result)
    highest = order[0]
    while parent[highest] != highest:
        highest = parent[highest]
    result[highest] = height[order[0]] - height[order[-1]]
    return result.reshape(power.shape)


def width_rad(power: Array32, row: int, column: int) -> float:
    """Diameter of the disc as large as the connected region around a peak that is above half of its power.

    Rows are taken to be spread evenly between the poles, columns around the circle; with one row it is the arc.
    """
    rows, columns = power.shape
    inside, stack = np.zeros(power.size, np.bool_), np.empty(power.size, np.int64)
    stack[0] = row * columns + column
    inside[stack[0]] = True
    _fill(power.ravel(), np.float32(0.5) * power[row, column], _beside(rows, columns), inside, stack)
    cells = np.count_nonzero(inside.reshape(rows, columns), axis=1)
    step = 2 * math.pi / columns
    if rows == 1:
        return float(step * int(cells[0]))
    sines = np.sin(math.pi / rows * (np.arange(rows) + 0.5))
    area = float(cells @ sines) * step * math.pi / rows
    return 2.0 * math.acos(max(1.0 - area / (2 * math.pi), -1.0))


@lru_cache(maxsize=4)
def _beside(rows: int, columns: int) -> NDArray[np.int32]:
    """The eight neighbours (T P, 8) of each cell: around the circle, and over a pole in the column half a turn away."""
    up, along = np.array([-1, -1, -1, 0, 0, 1, 1, 1]), np.array([-1, 0, 1, -1, 1, -1, 0, 1])
    row = np.repeat(np.arange(rows), columns)[:, None] + (up if rows > 1 else 0 * up)
    over = (row < 0) | (row >= rows)
    column = np.tile(np.arange(columns), rows)[:, None] + along + np.where(over, columns // 2, 0)
    beside: NDArray[np.int32] = (np.clip(row, 0, rows - 1) * columns + column % columns).astype(np.int32)
    return beside


@compiled
def _flood(height: Array32, order: Indices, beside: NDArray[np.int32], parent: Indices, result: Array32) -> None:
    """As the water falls, islands appear at their peaks and die where they meet a higher one. Cells of no island have
    a negative parent."""
    for number in range(order.size):
        cell = order[number]
        parent[cell] = cell
        top = cell
        for which in range(8):
            other = np.int64(beside[cell, which])
            if parent[other] < 0:
                continue
            while parent[other] != other:
                parent[other] = parent[parent[other]]
                other = parent[other]
            if other == top:
                continue
            lower = top if height[top] < height[other] else other
            top = other if lower == top else top
            result[lower] = height[lower] - height[cell]
            parent[lower] = top


@compiled
def _fill(
    height: Array32, least: np.float32, beside: NDArray[np.int32], inside: NDArray[np.bool_], stack: Indices
) -> None:
    """The connected part of `least` and more around the cell that is on the stack, which is inside."""
    size = 1
    while size > 0:
        size -= 1
        cell = stack[size]
        for which in range(8):
            other = beside[cell, which]
            if height[other] >= least and not inside[other]:
                inside[other] = True
                stack[size] = other
                size += 1
