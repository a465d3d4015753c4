"""Prominence and width of the peaks of a profile: how far one must come down from them, and how wide they stand."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wsr.machine_code import compiled, inner

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
    return np.asarray(_flood(np.ascontiguousarray(power, np.float32), order).reshape(power.shape))


def width_rad(power: Array32, row: int, column: int) -> float:
    """Diameter of the disc as large as the connected region around a peak that is above half of its power.

    Rows are taken to be spread evenly between the poles, columns around the circle; with one row it is the arc.
    """
    rows, columns = power.shape
    cells: Indices = _connected(power, np.float32(0.5) * power[row, column], row, column)
    step = 2 * math.pi / columns
    if rows == 1:
        return float(step * int(cells[0]))
    sines = np.sin(math.pi / rows * (np.arange(rows) + 0.5))
    area = float(cells @ sines) * step * math.pi / rows
    return 2.0 * math.acos(max(1.0 - area / (2 * math.pi), -1.0))


@inner
def _neighbour(row: int, column: int, which: int, rows: int, columns: int) -> int:
    """One of eight neighbours of a cell: around the circle, and over a pole to the column half a turn away."""
    offset = which if which < 4 else which + 1
    r, c = row + offset // 3 - 1, column + offset % 3 - 1
    if rows == 1:
        r = 0
    elif r < 0 or r >= rows:
        r = min(max(r, 0), rows - 1)
        c += columns // 2
    if c >= columns:
        c -= columns
    elif c < 0:
        c += columns
    return r * columns + c


@inner
def _root(parent: Indices, cell: int) -> int:
    while parent[cell] != cell:
        parent[cell] = parent[parent[cell]]
        cell = parent[cell]
    return cell


@compiled
def _flood(power: Array32, order: Indices) -> Array32:
    """As the water falls, islands appear at their peaks and die where they meet a higher one."""
    rows, columns = power.shape
    height = power.ravel()
    parent = np.full(height.size, -1, np.int64)
    result = np.zeros(height.size, np.float32)
    aside = np.array([-columns - 1, -columns, -columns + 1, -1, 1, columns - 1, columns, columns + 1])
    for cell in order:
        parent[cell] = cell
        row, column = cell // columns, cell % columns
        inside = 0 < row < rows - 1 and 0 < column < columns - 1
        for which in range(8):
            beside = cell + aside[which] if inside else _neighbour(row, column, which, rows, columns)
            if parent[beside] < 0:
                continue
            a, b = _root(parent, cell), _root(parent, beside)
            if a == b:
                continue
            if height[a] < height[b]:
                a, b = b, a
            result[b] = max(height[b] - height[cell], np.float32(0.0))
            parent[b] = a
    result[_root(parent, order[0])] = height[order[0]] - height[order[-1]]
    return result


@compiled
def _connected(power: Array32, least: np.float32, row: int, column: int) -> Indices:
    """How many cells of each row (T,) belong to the connected part of `least` and more around a cell, filled by runs
    of a row at a time."""
    rows, columns = power.shape
    inside = np.zeros((rows, columns), np.bool_)
    cells = np.zeros(rows, np.int64)
    stack = np.empty((3 * rows * columns + 8, 2), np.int64)
    stack[0, 0], stack[0, 1], size = row, column, 1
    while size > 0:
        size -= 1
        r, c = stack[size, 0], stack[size, 1]
        if inside[r, c]:
            continue
        left, length = c, 1
        while length < columns and power[r, left - 1 if left > 0 else columns - 1] >= least:
            left, length = left - 1 if left > 0 else columns - 1, length + 1
        while length < columns and power[r, (left + length) % columns] >= least:
            length += 1
        cells[r] += length
        for step in range(length):
            at = left + step
            inside[r, at if at < columns else at - columns] = True
        for side in (-1, 1):
            beside, shift = r + side, 0
            if rows == 1:
                continue
            if beside < 0 or beside >= rows:
                beside, shift = r, columns // 2
            was = False
            for step in range(-1, length + 1):
                at = (left + step + shift + columns) % columns
                now = power[beside, at] >= least and not inside[beside, at]
                if now and not was:
                    stack[size, 0], stack[size, 1] = beside, at
                    size += 1
                was = now
    return cells
