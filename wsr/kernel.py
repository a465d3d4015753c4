"""The Bartlett sum over the whole sphere of directions, fast: symmetric, in float32, with no sine in the inner loop.

Lengths are in half wavelengths, so that the round-trip phase 4 pi d / lambda is a whole turn per unit. For packet k and
direction (t, p) let a = sin t (x cos p + y sin p) and b = z cos t, in turns.

- (t, p), (pi - t, p), (t, p + pi) and (pi - t, p + pi) share a and b but for the signs: eight real sums of one product
  serve all four directions.
- 2a = f(t+p) - f(p-t) with f(q) = x sin q - y cos q, and f(q + pi) = -f(q). On a grid with one step in both angles f
  has as many values as there are rows, so that phasors come from one small table, the wave, and e^{-ja} is one complex
  product.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from wsr.directions import ROWS, grid
from wsr.machine_code import compiled, inner, shared

Array32 = NDArray[np.float32]
Array64 = NDArray[np.float64]

# sin(pi r) / r and cos(pi r) on |r| <= 1/2 as polynomials in r^2: minimax, errors 3e-9 and 5e-8 before rounding.
_S0, _S1, _S2, _S3, _S4 = (
    np.float32(c) for c in (3.14159258004, -5.16770687886, 2.55003137621, -0.598045167596, 0.0772201158771)
)
_C0, _C1, _C2, _C3, _C4 = (
    np.float32(c) for c in (0.999999953466, -4.93479285857, 4.0584119115, -1.33188014072, 0.219696750858)
)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
# A block is long enough that adding up vector lanes at its end costs little; a tile of columns needs, row after row,
# the same 60 entries of the wave but one, twice, 0.7 MB, which the second-level cache holds.
_BLOCK = 704
_TILE = 60
# Up to so many packets vector lanes run over columns instead of packets, in groups of so many packets: over those of
# the one-degree grid and a few, so that none is left over for a loop without lanes. So far apart are packets' waves.
_FEW = 240
_GROUP = 16
_WIDE = 184
_STRIDE = 368
# float32 in a cache line of 64 bytes.
_LINE = 16


def bartlett_power(chi_half_wavelengths: Array64, channel: NDArray[np.complex128], rows: int = ROWS) -> Array32:
    """|sum_k g_k exp(-j 2 pi u . c_k)|^2 over `grid(rows)`, float32 (rows, 2 rows).

    c (M, 3) in half wavelengths, g (M,), both finite. Scale g so that the sum of |g| is about 1. The error is about
    1e-6 of the largest possible value, sum |g| squared. Raises ValueError if `rows` is odd.
    """
    sums = empty_sums(rows)
    add_packets(sums, chi_half_wavelengths, channel)
    return power_of(sums)


def empty_sums(rows: int = ROWS) -> Array32:
    """Running sums (8, rows / 2, rows) float32 of no packets. Raises ValueError if `rows` is odd."""
    if rows <= 0 or rows % 2:
        raise ValueError(f"rows is {rows}; the grid needs an even number to be symmetric about the horizon")
    return np.zeros((8, rows // 2, rows), np.float32)


def add_packets(sums: Array32, chi_half_wavelengths: Array64, channel: NDArray[np.complex128]) -> None:
    """Add packets c (M, 3), g (M,) to running sums in place. The sum is linear in g: adding -g takes packets out."""
    x, y, z = (np.ascontiguousarray(axis, np.float64) for axis in chi_half_wavelengths.T)
    g_re, g_im = (np.ascontiguousarray(part, np.float32) for part in (channel.real, channel.imag))
    if not x.size:
        return
    rows = sums.shape[2]
    angles = _angles(rows)
    if x.size <= _FEW and rows <= ROWS:
        room = _aligned((2 * _GROUP * _STRIDE,)), _aligned((8 * _WIDE,))
        _sum_up_few(sums, x, y, z, g_re, g_im, *angles, *room)
    else:
        # As many blocks as needed, all about as long, whole cache lines each.
        blocks = math.ceil(x.size / _BLOCK)
        block = math.ceil(x.size / blocks / _LINE) * _LINE
        room = _aligned((2, 2 * rows - 1, block)), _aligned((4, rows // 2, block))
        _sum_up(sums, x, y, z, g_re, g_im, *angles, *room)


@lru_cache(maxsize=4)
def _angles(rows: int) -> tuple[Array64, Array64, Array64]:
    """Half of x's and of y's weights in f, each (rows,), and cosines (rows,) of the polar angles, which are also the
    angles q."""
    polar = grid(rows)[1]
    return 0.5 * np.sin(polar), -0.5 * np.cos(polar), np.cos(polar)


def power_of(sums: Array32) -> Array32:
    """Powers (rows, 2 rows) of running sums.

    sum g e^{-jb} e^{-ja} = (ur_c + ui_s) + j (ui_c - ur_s), and its three mirrors.
    """
    ur_c, ui_c, dr_c, di_c, ur_s, ui_s, dr_s, di_s = sums
    upper = [(ur_c + ui_s) ** 2 + (ui_c - ur_s) ** 2, (ur_c - ui_s) ** 2 + (ui_c + ur_s) ** 2]
    lower = [(dr_c + di_s) ** 2 + (di_c - dr_s) ** 2, (dr_c - di_s) ** 2 + (di_c + dr_s) ** 2]
    return np.ascontiguousarray(np.vstack([np.hstack(upper), np.hstack(lower)[::-1]]), np.float32)


def warm_up() -> None:
    """Load or compile the machine code, so that the first real profile is as fast as the rest."""
    for packets in (1, _FEW + 1):
        bartlett_power(np.zeros((packets, 3)), np.ones(packets, np.complex128), 2)


def _aligned(shape: tuple[int, ...]) -> Array32:
    """An array that starts on a cache line: else half of the 64-byte loads of the inner loop touch two lines, which
    makes the whole sum up to 1.6 times slower."""
    size = math.prod(shape)
    raw = np.empty(size + _LINE, np.float32)
    start = -raw.ctypes.data // raw.itemsize % _LINE
    return raw[start : start + size].reshape(shape)


@shared
def phasor(r: np.float32) -> tuple[np.float32, np.float32]:
    """Cosine and sine of r turns, |r| <= 1/2, float32: by the half angle, so that no quadrant has to be told."""
    q = r * r
    s = r * (_S0 + q * (_S1 + q * (_S2 + q * (_S3 + q * _S4))))
    c = _C0 + q * (_C1 + q * (_C2 + q * (_C3 + q * _C4)))
    return _ONE - _TWO * s * s, _TWO * s * c


@shared
def phasors(turns: Array32 | Array64, cosine: Array32, sine: Array32) -> None:
    """cosine and sine (n,) of the angles `turns` (n,): reduced in float64, so that long apertures lose nothing."""
    for k in range(turns.size):
        cosine[k], sine[k] = phasor(np.float32(turns[k] - np.rint(turns[k])))


@inner
def _across(x: Array64, y: Array64, along_x: float, along_y: float, turns: Array64) -> None:
    """turns = x along_x + y along_y, in place."""
    for k in range(turns.size):
        turns[k] = x[k] * along_x + y[k] * along_y


@inner
def _turn(
    turns: Array64,
    g_re: Array32,
    g_im: Array32,
    up_re: Array32,
    up_im: Array32,
    down_re: Array32,
    down_im: Array32,
) -> None:
    """g e^{-jb} into `up`, for a row above the horizon, and g e^{+jb} into `down`, for its mirror image."""
    cosine = np.empty(turns.size, np.float32)
    sine = np.empty(turns.size, np.float32)
    phasors(turns, cosine, sine)
    for k in range(turns.size):
        up_re[k] = g_re[k] * cosine[k] + g_im[k] * sine[k]
        up_im[k] = g_im[k] * cosine[k] - g_re[k] * sine[k]
        down_re[k] = g_re[k] * cosine[k] - g_im[k] * sine[k]
        down_im[k] = g_im[k] * cosine[k] + g_re[k] * sine[k]


@inner
def _add(
    size: int, wave: Array32, turned: Array32, plus: int, minus: int, row: int, column: int, sums: Array32
) -> None:
    """Add a block of packets to the eight sums of one direction and its mirrors: the inner loop.

    It takes whole arrays and indices: making views of their rows for each call costs as much as a hundred packets.
    """
    ur_c = ui_c = dr_c = di_c = np.float32(0.0)
    ur_s = ui_s = dr_s = di_s = np.float32(0.0)
    for k in range(size):
        plus_cos, plus_sin = wave[0, plus, k], wave[1, plus, k]
        minus_cos, minus_sin = wave[0, minus, k], wave[1, minus, k]
        cosine = plus_cos * minus_cos + plus_sin * minus_sin
        sine = plus_sin * minus_cos - plus_cos * minus_sin
        ur_c += turned[0, row, k] * cosine
        ui_c += turned[1, row, k] * cosine
        dr_c += turned[2, row, k] * cosine
        di_c += turned[3, row, k] * cosine
        ur_s += turned[0, row, k] * sine
        ui_s += turned[1, row, k] * sine
        dr_s += turned[2, row, k] * sine
        di_s += turned[3, row, k] * sine
    sums[0, row, column] += ur_c
    sums[1, row, column] += ui_c
    sums[2, row, column] += dr_c
    sums[3, row, column] += di_c
    sums[4, row, column] += ur_s
    sums[5, row, column] += ui_s
    sums[6, row, column] += dr_s
    sums[7, row, column] += di_s


@compiled
def _sum_up(
    sums: Array32,
    x: Array64,
    y: Array64,
    z: Array64,
    g_re: Array32,
    g_im: Array32,
    along_x: Array64,
    along_y: Array64,
    cos_polar: Array64,
    wave: Array32,
    turned: Array32,
) -> None:
    """Add to the sums (8, T/2, P/2) of cos a and sin a with g e^{-jb} (upper half) and g e^{+jb} (lower half).

    Room to work in: `wave` (2, 2 P/2 - 1, block), cosines and sines of f at angles from -pi/2 on, and `turned`
    (4, T/2, block).
    """
    columns, block = cos_polar.size, wave.shape[2]
    rows = columns // 2
    for start in range(0, x.size, block):
        bx, by, bz = x[start : start + block], y[start : start + block], z[start : start + block]
        turns = np.empty(bx.size, np.float64)
        for q in range(columns):
            _across(bx, by, along_x[q], along_y[q], turns)
            phasors(turns, wave[0, rows + q], wave[1, rows + q])
        for q in range(rows):
            _opposite(wave, q, q + columns)
        for q in range(rows, columns - 1):
            _opposite(wave, q + columns, q)
        for row in range(rows):
            _turn(
                bz * cos_polar[row],
                g_re[start : start + block],
                g_im[start : start + block],
                turned[0, row],
                turned[1, row],
                turned[2, row],
                turned[3, row],
            )
        for first in range(0, columns, _TILE):
            for row in range(rows):
                for column in range(first, min(first + _TILE, columns)):
                    # p begins at -pi: f there is that of half a turn on with the other sign, and so both change places.
                    _add(bx.size, wave, turned, column - row - 1 + rows, column + row + rows, row, column, sums)


@inner
def _opposite(wave: Array32, into: int, of: int) -> None:
    """f half a turn away."""
    for k in range(wave.shape[2]):
        wave[0, into, k] = wave[0, of, k]
        wave[1, into, k] = -wave[1, of, k]


@inner
def _add_four(wave: Array32, plus: int, minus: int, turned: Array32, row: int, first: int, total: Array32) -> None:
    """Add four packets of a group to `total` (8 x _WIDE,), over the columns of a row: the inner loop for few packets.

    Their entries in the wave begin at `plus` and `minus`. Flat arrays with distances that are known when this is
    compiled, and unsigned indices, which cannot wrap around, let the compiler see that lanes are safe.
    """
    a, b, c, d = turned[0, row], turned[1, row], turned[2, row], turned[3, row]
    a0, a1, a2, a3 = a[first], a[first + 1], a[first + 2], a[first + 3]
    b0, b1, b2, b3 = b[first], b[first + 1], b[first + 2], b[first + 3]
    c0, c1, c2, c3 = c[first], c[first + 1], c[first + 2], c[first + 3]
    d0, d1, d2, d3 = d[first], d[first + 1], d[first + 2], d[first + 3]
    p, m = np.uintp(plus), np.uintp(minus)
    for column in range(_WIDE):
        j = np.uintp(column)
        cos0, sin0 = _product(wave, p, m)
        cos1, sin1 = _product(wave, p + np.uintp(_STRIDE), m + np.uintp(_STRIDE))
        cos2, sin2 = _product(wave, p + np.uintp(2 * _STRIDE), m + np.uintp(2 * _STRIDE))
        cos3, sin3 = _product(wave, p + np.uintp(3 * _STRIDE), m + np.uintp(3 * _STRIDE))
        total[j] += (a0 * cos0 + a1 * cos1) + (a2 * cos2 + a3 * cos3)
        total[j + np.uintp(_WIDE)] += (b0 * cos0 + b1 * cos1) + (b2 * cos2 + b3 * cos3)
        total[j + np.uintp(2 * _WIDE)] += (c0 * cos0 + c1 * cos1) + (c2 * cos2 + c3 * cos3)
        total[j + np.uintp(3 * _WIDE)] += (d0 * cos0 + d1 * cos1) + (d2 * cos2 + d3 * cos3)
        total[j + np.uintp(4 * _WIDE)] += (a0 * sin0 + a1 * sin1) + (a2 * sin2 + a3 * sin3)
        total[j + np.uintp(5 * _WIDE)] += (b0 * sin0 + b1 * sin1) + (b2 * sin2 + b3 * sin3)
        total[j + np.uintp(6 * _WIDE)] += (c0 * sin0 + c1 * sin1) + (c2 * sin2 + c3 * sin3)
        total[j + np.uintp(7 * _WIDE)] += (d0 * sin0 + d1 * sin1) + (d2 * sin2 + d3 * sin3)
        p += np.uintp(1)
        m += np.uintp(1)


@inner
def _product(wave: Array32, plus: np.uintp, minus: np.uintp) -> tuple[np.float32, np.float32]:
    """Cosine and sine of the difference of two entries of a packet."""
    plus_cos, plus_sin = wave[plus], wave[plus + np.uintp(_GROUP * _STRIDE)]
    minus_cos, minus_sin = wave[minus], wave[minus + np.uintp(_GROUP * _STRIDE)]
    return plus_cos * minus_cos + plus_sin * minus_sin, plus_sin * minus_cos - plus_cos * minus_sin


@compiled
def _sum_up_few(
    sums: Array32,
    x: Array64,
    y: Array64,
    z: Array64,
    g_re: Array32,
    g_im: Array32,
    along_x: Array64,
    along_y: Array64,
    cos_polar: Array64,
    wave: Array32,
    total: Array32,
) -> None:
    """`_sum_up` for few packets, a group at a time: vector lanes run over columns, so that none has to be added up.

    Room to work in: `wave` (2 x _GROUP x _STRIDE,) and `total` (8 x _WIDE,).
    """
    columns = cos_polar.size
    rows = columns // 2
    # Members of the last group that stand for no packet have no weight, but must be finite.
    wave[:] = 0.0
    turns = np.empty(columns, np.float64)
    turned = np.empty((4, rows, _GROUP), np.float32)
    up = turned.reshape(4, rows * _GROUP)
    bz = np.empty(rows * _GROUP, np.float64)
    group_re = np.empty(rows * _GROUP, np.float32)
    group_im = np.empty(rows * _GROUP, np.float32)
    for start in range(0, x.size, _GROUP):
        size = min(_GROUP, x.size - start)
        for k in range(size):
            cosine, sine = wave[k * _STRIDE :], wave[(_GROUP + k) * _STRIDE :]
            bx, by = x[start + k], y[start + k]
            for q in range(columns):
                turns[q] = bx * along_x[q] + by * along_y[q]
            phasors(turns, cosine[rows:], sine[rows:])
            for q in range(rows):
                cosine[q], sine[q] = cosine[q + columns], -sine[q + columns]
            for q in range(rows, columns - 1):
                cosine[q + columns], sine[q + columns] = cosine[q], -sine[q]
        bz[:] = 0.0
        group_re[:] = 0.0
        group_im[:] = 0.0
        for k in range(size):
            for row in range(rows):
                bz[row * _GROUP + k] = z[start + k] * cos_polar[row]
                group_re[row * _GROUP + k] = g_re[start + k]
                group_im[row * _GROUP + k] = g_im[start + k]
        _turn(bz, group_re, group_im, up[0], up[1], up[2], up[3])
        for row in range(rows):
            total[:] = 0.0
            for four in range(0, size, 4):
                plus, minus = four * _STRIDE + rows - row - 1, four * _STRIDE + rows + row
                _add_four(wave, plus, minus, turned, row, four, total)
            for part in range(8):
                into, added = sums[part, row], total[part * _WIDE :]
                for column in range(columns):
                    into[column] += added[column]
