"""The machine code of `wsr.subapertures` and `wsr.focus`: scores of directions and ranges, and the climb from one.

One kernel does both: what several kernels are made of is compiled anew for each of them. It makes no arrays: each kind
that a kernel makes is compiled too.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wsr.kernel import phasor
from wsr.machine_code import compiled, inner
from wsr.ofdm import LAG, UNIT_HZ

BLOCK = 64
"""Directions that are scored at once: a few vector registers of them, and what is added up stays in the first cache."""
MAX_DELAY_NS = 60.0
DELAY_NS_PER_RAD = -1e9 / (2 * math.pi * LAG * UNIT_HZ)
# A step of the climb stays within 1.5 of its own grid.
_MAX_STEP = 1.5
# From a point of its cube to the next, by axis.
_STRIDES = 9, 3, 1
_LOG_RANGE_STEP, _LEAST_LOG_RANGE_STEP = 0.35, 0.08
# Numbers of a climb: where it is, its step and the least one, limits of inverse ranges and polar angles, 1 over a level
# path, the coherence above which the whole aperture is looked at alone, and the decay of the weight for delays.
AZIMUTH, POLAR, INVERSE, COHERENCE, STEP, LEAST_STEP, LOW, HIGH, TOP, BOTTOM, PLANAR, ABOVE, DELAY_NS = range(13)

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Indices = NDArray[np.int64]


@compiled
def search(
    x: Array32,
    h: Array32,
    cuts: Indices,
    pieces: Indices,
    lag: Array32,
    power: float,
    u: Array32,
    found: Array32,
    steering: Array32,
    y: Array32,
    total: Array32,
    sums: Array32,
    climb: Array,
    peak: Array,
    cube: Array,
    solve: Array,
    move: Array,
    steps: int,
) -> None:
    """Coherence, and behind it the phase of the lagged product, into `found` (N, T, K, 2 W) at each scale, for u
    (N, 4 W): N blocks of directions with inverse ranges a wavelength, 0 for the far field. T parts share their bins at
    x (4, B), the square of the distance last, and h (T, 2, S, B) are their channels; the rest is as in `SubApertures`,
    an empty `lag` without delays.

    With `steps` it climbs instead, from `climb`, and leaves there where it ends: by scores of 3 x 3 x 3 points, laid
    out in u, over their `peak` (K,), each step to the maximum of the quadratic through them. Called one by one these
    would spend most of their time in the calls. `steering` (B, 2 W), y (T, C, S, 2 W), `total` (S, 4 W), `sums`
    (4 W,), `cube` (27,), `solve` (3, 4) and `move` (3,) are room to work in.
    """
    scales, count = found.shape[2], pieces.shape[0]
    spans, log_step, delays = 3 if climb[INVERSE] > 0.0 else 1, _LOG_RANGE_STEP, lag.size > 0
    for step in range(steps if steps > 0 else 1):
        if steps > 0:
            _lay(climb, log_step, spans, u)
        for block in range(u.shape[0]):
            _steer(x, h, cuts, u[block], steering, y)
            for link in range(h.shape[0]):
                _fuse(y[link], pieces, count, lag, delays, power, total, sums, found[block, link])
        if steps > 0:
            _fused(found, scales, delays, climb, peak, spans, cube, move)
            log_step = _move(climb, log_step, spans, cube, solve, move)
            if step == steps // 2 and climb[COHERENCE] > climb[ABOVE]:
                scales, count, delays = 1, 0, False
                peak[0] = 1.0
                while count < pieces.shape[0] and pieces[count, 0] == 0:
                    count += 1


@inner
def _steer(x: Array32, h: Array32, cuts: Indices, u: Array32, steering: Array32, y: Array32) -> None:
    """Sums of runs, y (T, C, S, 2 W), in directions u (4 W,): h times exp(+j 2 pi d), d = |r u - x| - r without
    cancellation, with q = 1 / r  (q x^2 - 2 u.x) / (sqrt(1 - 2 q u.x + q^2 x^2) + 1)."""
    one, two, zero = np.float32(1.0), np.float32(2.0), np.float32(0.0)
    for run in range(cuts.size - 1):
        first, after = cuts[run], cuts[run + 1]
        for b in range(first, after):
            east, north, up, apart, out = x[0, b], x[1, b], x[2, b], x[3, b], steering[b - first]
            for m in range(BLOCK):
                q = u[m + 3 * BLOCK]
                more = q * apart - two * (u[m] * east + u[m + BLOCK] * north + u[m + 2 * BLOCK] * up)
                square = one + q * more
                turns = more / (math.sqrt(square if square > zero else zero) + one)
                out[m], out[m + BLOCK] = phasor(turns - np.rint(turns))
        for link in range(h.shape[0]):
            for s in range(h.shape[2]):
                total = y[link, run, s]
                for m in range(2 * BLOCK):
                    total[m] = zero
                for b in range(first, after):
                    re, im, at = h[link, 0, s, b], h[link, 1, s, b], steering[b - first]
                    for m in range(BLOCK):
                        total[m] += re * at[m] - im * at[m + BLOCK]
                        total[m + BLOCK] += re * at[m + BLOCK] + im * at[m]


@inner
def _fuse(
    y: Array32,
    pieces: Indices,
    count: int,
    lag: Array32,
    delays: bool,
    power: float,
    total: Array32,
    sums: Array32,
    found: Array32,
) -> None:
    """Coherence and phase of the lagged product (K, 2 W) at each scale, from the sums (C, S, 2 W) of runs.

    `total` (S, 4 W): of a sub-aperture, and behind them of a piece of it. `sums` (4 W,): how well both match, energy,
    and the lagged product.
    """
    combos, piece = y.shape[1], 0
    squares = size = zero = np.float32(0.0)
    for m in range(4 * BLOCK):
        sums[m] = zero
    for p in range(count):
        for s in range(combos):
            row = total[s, piece:]
            for m in range(2 * BLOCK):
                row[m] = zero
            for run in range(pieces[p, 2], pieces[p, 3]):
                more = y[run, s]
                for m in range(2 * BLOCK):
                    row[m] += more[m]
        if piece > 0:
            # With the sign that matches.
            for m in range(BLOCK):
                sums[m] = zero
            for s in range(combos):
                row = total[s]
                for m in range(BLOCK):
                    sums[m] += row[m] * row[m + 2 * BLOCK] + row[m + BLOCK] * row[m + 3 * BLOCK]
            for s in range(combos):
                row = total[s]
                for m in range(BLOCK):
                    row[m] += row[m + 2 * BLOCK] if sums[m] >= zero else -row[m + 2 * BLOCK]
                    row[m + BLOCK] += row[m + 3 * BLOCK] if sums[m] >= zero else -row[m + 3 * BLOCK]
        size += np.float32(pieces[p, 4])
        ends = p == count - 1 or pieces[p + 1, 0] != pieces[p, 0]
        if not ends and pieces[p + 1, 1] == pieces[p, 1]:
            piece = 2 * BLOCK
            continue
        piece = 0
        for s in range(combos):
            row = total[s]
            for m in range(BLOCK):
                sums[m + BLOCK] += row[m] * row[m] + row[m + BLOCK] * row[m + BLOCK]
            for other in range(combos if delays else 0):
                re, im, beside = lag[0, s, other], lag[1, s, other], total[other]
                for m in range(BLOCK):
                    product_re = row[m] * beside[m] + row[m + BLOCK] * beside[m + BLOCK]
                    product_im = row[m + BLOCK] * beside[m] - row[m] * beside[m + BLOCK]
                    sums[m + 2 * BLOCK] += product_re * re - product_im * im
                    sums[m + 3 * BLOCK] += product_re * im + product_im * re
        squares += size * size
        size = zero
        if ends:
            out, share = found[pieces[p, 0]], np.float32(1.0) / (np.float32(power) * squares)
            for m in range(BLOCK):
                out[m] = sums[m + BLOCK] * share
                out[m + BLOCK] = _angle(sums[m + 2 * BLOCK], sums[m + 3 * BLOCK])
                sums[m + BLOCK] = sums[m + 2 * BLOCK] = sums[m + 3 * BLOCK] = zero
            squares = zero


# arctan(a) / a on 0 <= a <= 1 as a polynomial in a^2: minimax, error 4e-8 rad before rounding.
_A0, _A1, _A2, _A3, _A4, _A5, _A6, _A7 = (
    np.float32(c)
    for c in (
        0.99999933558,
        -0.33329860775,
        0.19946565506,
        -0.1390862868,
        0.096421948193,
        -0.055912289341,
        0.021862930039,
        -0.0040545590533,
    )
)


@inner
def _angle(x: np.float32, y: np.float32) -> np.float32:
    """arctan2(y, x), which the mathematical library has for one number at a time only."""
    zero, one, half, quarter = np.float32(0.0), np.float32(1.0), np.float32(math.pi), np.float32(math.pi / 2)
    ax, ay = abs(x), abs(y)
    top = ax if ax > ay else ay
    ratio = (ay if ax > ay else ax) / (top if top > zero else one)
    q = ratio * ratio
    value = _A4 + q * (_A5 + q * (_A6 + q * _A7))
    value = ratio * (_A0 + q * (_A1 + q * (_A2 + q * (_A3 + q * value))))
    value = quarter - value if ay > ax else value
    value = half - value if x < zero else value
    return -value if y < zero else value


@inner
def _lay(climb: Array, log_step: float, spans: int, u: Array32) -> None:
    """Points around where the climb is: directions, and inverse ranges if it has one."""
    d_azimuth, d_polar = _steps(climb)
    n = 0
    for i in range(3):
        a = climb[AZIMUTH] + (i - 1) * d_azimuth
        for j in range(3):
            t = climb[POLAR] + (j - 1) * d_polar
            for k in range(spans):
                u[0, n], u[0, n + BLOCK] = math.sin(t) * math.cos(a), math.sin(t) * math.sin(a)
                u[0, n + 2 * BLOCK], u[0, n + 3 * BLOCK] = math.cos(t), 0.0
                if spans == 3:
                    inverse = climb[INVERSE] * math.exp((1 - k) * log_step)
                    u[0, n + 3 * BLOCK] = _within(inverse, climb[LOW], climb[HIGH])
                n += 1


@inner
def _steps(climb: Array) -> tuple[float, float]:
    sine = math.sin(climb[POLAR])
    return climb[STEP] / (sine if sine > 0.1 else 0.1), climb[STEP] * (3.0 if climb[PLANAR] > 0.0 else 1.0)


@inner
def _within(value: float, low: float, high: float) -> float:
    value = value if value > low else low
    return value if value < high else high


@inner
def _fused(
    found: Array32, scales: int, delays: bool, climb: Array, peak: Array, spans: int, cube: Array, move: Array
) -> None:
    """Scores over their peaks, mean over scales, into `cube`; the highest one's coherence, and the `move` there."""
    n, top = 0, 0.0
    for i in range(3):
        for j in range(3):
            for k in range(spans):
                value = 0.0
                for scale in range(scales):
                    late = 1.0
                    if delays:
                        late_ns = _within(found[0, 0, scale, n + BLOCK] * DELAY_NS_PER_RAD, -MAX_DELAY_NS, MAX_DELAY_NS)
                        late = math.exp(late_ns * (-1.0 / climb[DELAY_NS]))
                    value += found[0, 0, scale, n] * late / peak[scale]
                cube[n] = value / scales
                if n == 0 or value > top:
                    top, climb[COHERENCE] = value, found[0, 0, 0, n]
                    move[0], move[1], move[2] = i - 1.0, j - 1.0, k - 1.0
                n += 1


@inner
def _move(climb: Array, log_step: float, spans: int, cube: Array, solve: Array, move: Array) -> float:
    """One step, and the next one's in the logarithm of the range."""
    if spans == 3:
        _newton(cube, solve, move)
    else:
        move[2] = 0.0
    d_azimuth, d_polar = _steps(climb)
    climb[AZIMUTH] += move[0] * d_azimuth
    polar = climb[POLAR] + move[1] * d_polar
    if climb[PLANAR] > 0.0 and polar > math.pi / 2:
        polar = math.pi - polar
    climb[POLAR] = _within(polar, climb[TOP], climb[BOTTOM])
    if spans == 3:
        climb[INVERSE] = _within(climb[INVERSE] * math.exp(-move[2] * log_step), climb[LOW], climb[HIGH])
    if abs(move[0]) < 1.0 and abs(move[1]) < 1.0 and abs(move[2]) < 1.0:
        climb[STEP] = 0.5 * climb[STEP] if 0.5 * climb[STEP] > climb[LEAST_STEP] else climb[LEAST_STEP]
        log_step = 0.7 * log_step if 0.7 * log_step > _LEAST_LOG_RANGE_STEP else _LEAST_LOG_RANGE_STEP
    return log_step


@inner
def _newton(c: Array, solve: Array, move: Array) -> None:
    """The offset of the maximum of the quadratic through 3 x 3 x 3 points (27,), where it has one, into `move`; else
    that is left as it is. `solve` (3, 4) is room for the equations, the slope on their right."""
    most = 0.0
    for i in range(3):
        at = _STRIDES[i]
        up, down = c[13 + at], c[13 - at]
        solve[i, 3] = (up - down) * 0.5
        solve[i, i] = 2.0 * c[13] - up - down
        most = abs(solve[i, i]) if abs(solve[i, i]) > most else most
        for j in range(i):
            to = _STRIDES[j]
            solve[i, j] = (c[13 + to + at] + c[13 - to - at] - c[13 + to - at] - c[13 - to + at]) * -0.25
    # Cholesky's factors in place; a pivot that is not positive: no maximum. Then what it solves, in place.
    for i in range(3):
        for j in range(i + 1):
            for k in range(j):
                solve[i, j] -= solve[i, k] * solve[j, k]
            if i != j:
                solve[i, j] /= solve[j, j]
        if not solve[i, i] > 1e-9 * most:
            return
        solve[i, i] = math.sqrt(solve[i, i])
        for k in range(i):
            solve[i, 3] -= solve[i, k] * solve[k, 3]
        solve[i, 3] /= solve[i, i]
    longest = _MAX_STEP
    for i in range(2, -1, -1):
        for k in range(i + 1, 3):
            solve[i, 3] -= solve[k, i] * solve[k, 3]
        solve[i, 3] /= solve[i, i]
        longest = abs(solve[i, 3]) if abs(solve[i, 3]) > longest else longest
    for i in range(3):
        move[i] = solve[i, 3] * (_MAX_STEP / longest)
