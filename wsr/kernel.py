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
_STRIDE = np.uintp(368)
_TWICE, _THRICE, _FOUR, _SINES = 2 * _STRIDE, 3 * _STRIDE, 4 * _STRIDE, _GROUP * _STRIDE
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
    packets, rows = len(channel), sums.shape[2]
    if packets == 0:
        return
    few = packets <= _FEW and rows <= ROWS
    # As many blocks as needed, all about as long, whole cache lines each; of few packets whole groups.
    block = math.ceil(packets / math.ceil(packets / _BLOCK) / _LINE) * _LINE
    size = math.ceil(packets / _GROUP) * _GROUP if few else packets
    # Members of the last group that stand for no packet have no weight.
    places, parts = np.zeros((3, size)), np.zeros((2, size), np.float32)
    places[:, :packets] = chi_half_wavelengths.T
    parts[0, :packets], parts[1, :packets] = channel.real, channel.imag
    if few:
        wave, turned, total = _aligned((2 * int(_SINES),)), np.empty((_GROUP, 4), np.float32), _aligned((8 * _WIDE,))
        wave.fill(0.0)
        _sum_up_few(sums, packets, places, parts, _angles(rows), wave, turned, total)
        return
    wave, turned = _aligned((2, 2 * rows - 1, block)), _aligned((4, rows // 2, block))
    for start in range(0, packets, block):
        here, g = places[:, start : start + block].copy(), parts[:, start : start + block].copy()
        _sum_up(sums, here, g, _angles(rows), wave, turned)


@lru_cache(maxsize=4)
def _angles(rows: int) -> Array64:
    """(3, rows): half of x's and of y's weights in f, and cosines of the polar angles, which are also the angles q."""
    polar = grid(rows)[1]
    return np.stack([0.5 * np.sin(polar), -0.5 * np.cos(polar), np.cos(polar)])


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


@inner
def turned_phasor(turns: float) -> tuple[np.float32, np.float32]:
    """Cosine and sine of so many turns: reduced in float64, so that long apertures lose nothing."""
    return phasor(np.float32(turns - np.rint(turns)))


@compiled
def _sum_up(sums: Array32, places: Array64, parts: Array32, angles: Array64, wave: Array32, turned: Array32) -> None:
    """Add to the sums (8, T/2, P/2) of cos a and sin a with g e^{-jb} (upper half) and g e^{+jb} (lower half).

    A block of packets at `places` (3, M <= B) with `parts` (2, M) of g. Room to work in: `wave` (2, 2 P/2 - 1, B),
    cosines and sines of f at angles from -pi/2 on, and `turned` (4, T/2, B).
    """
    size, rows, columns = places.shape[1], sums.shape[1], sums.shape[2]
    for q in range(columns):
        for k in range(size):
            pair = turned_phasor(places[0, k] * angles[0, q] + places[1, k] * angles[1, q])
            wave[0, rows + q, k], wave[1, rows + q, k] = pair
    for q in range(2 * columns - 1):
        # f half a turn away.
        of = q + columns if q < rows else q - columns
        if q < rows or q >= rows + columns:
            for k in range(size):
                wave[0, q, k], wave[1, q, k] = wave[0, of, k], -wave[1, of, k]
    for row in range(rows):
        for k in range(size):
            cosine, sine = turned_phasor(places[2, k] * angles[2, row])
            turned[0, row, k] = parts[0, k] * cosine + parts[1, k] * sine
            turned[1, row, k] = parts[1, k] * cosine - parts[0, k] * sine
            turned[2, row, k] = parts[0, k] * cosine - parts[1, k] * sine
            turned[3, row, k] = parts[1, k] * cosine + parts[0, k] * sine
    for first in range(0, columns, _TILE):
        for row in range(rows):
            for column in range(first, first + _TILE if first + _TILE < columns else columns):
                # p begins at -pi: f there is that of half a turn on with the other sign, and so both change places.
                plus, minus = column - row - 1 + rows, column + row + rows
                ur_c = ui_c = dr_c = di_c = ur_s = ui_s = dr_s = di_s = np.float32(0.0)
                for k in range(size):
                    cosine = wave[0, plus, k] * wave[0, minus, k] + wave[1, plus, k] * wave[1, minus, k]
                    sine = wave[1, plus, k] * wave[0, minus, k] - wave[0, plus, k] * wave[1, minus, k]
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


@inner
def _product(wave: Array32, plus: np.uintp, minus: np.uintp) -> tuple[np.float32, np.float32]:
    """Cosine and sine of the difference of two entries of a packet."""
    plus_cos, plus_sin = wave[plus], wave[plus + _SINES]
    minus_cos, minus_sin = wave[minus], wave[minus + _SINES]
    return plus_cos * minus_cos + plus_sin * minus_sin, plus_sin * minus_cos - plus_cos * minus_sin


@compiled
def _sum_up_few(
    sums: Array32,
    packets: int,
    places: Array64,
    parts: Array32,
    angles: Array64,
    wave: Array32,
    turned: Array32,
    total: Array32,
) -> None:
    """`_sum_up` for few packets, in whole groups: vector lanes run over columns, so that none has to be added up.

    Room to work in: `wave` (2 x _GROUP x _STRIDE,), which must be finite, `turned` (_GROUP, 4) and `total`
    (8 x _WIDE,). Flat arrays with distances that are known when this is compiled, and unsigned indices, which cannot
    wrap around, let the compiler see that lanes are safe.
    """
    rows, columns = sums.shape[1], sums.shape[2]
    half, whole = np.uintp(rows), np.uintp(columns)
    for start in range(0, packets, _GROUP):
        at = np.uintp(0)
        for k in range(start, start + _GROUP):
            for q in range(whole):
                turns = places[0, k] * angles[0, q] + places[1, k] * angles[1, q]
                wave[at + half + q], wave[at + half + q + _SINES] = turned_phasor(turns)
            for q in range(half):
                # f half a turn away.
                low, high = at + q, at + half + q
                wave[low], wave[low + _SINES] = wave[low + whole], -wave[low + whole + _SINES]
                wave[high + whole], wave[high + whole + _SINES] = wave[high], -wave[high + _SINES]
            at += _STRIDE
        for row in range(rows):
            for k in range(_GROUP):
                cosine, sine = turned_phasor(places[2, start + k] * angles[2, row])
                re, im = parts[0, start + k], parts[1, start + k]
                turned[k, 0], turned[k, 1] = re * cosine + im * sine, im * cosine - re * sine
                turned[k, 2], turned[k, 3] = re * cosine - im * sine, im * cosine + re * sine
            for k in range(total.size):
                total[k] = 0.0
            p, m = np.uintp(rows - row - 1), np.uintp(rows + row)
            for k in range(0, _GROUP if start + _GROUP < packets else packets - start, 4):
                a0, a1, a2, a3 = turned[k, 0], turned[k + 1, 0], turned[k + 2, 0], turned[k + 3, 0]
                b0, b1, b2, b3 = turned[k, 1], turned[k + 1, 1], turned[k + 2, 1], turned[k + 3, 1]
                c0, c1, c2, c3 = turned[k, 2], turned[k + 1, 2], turned[k + 2, 2], turned[k + 3, 2]
                d0, d1, d2, d3 = turned[k, 3], turned[k + 1, 3], turned[k + 2, 3], turned[k + 3, 3]
                for column in range(_WIDE):
                    j = np.uintp(column)
                    cos0, sin0 = _product(wave, p + j, m + j)
                    cos1, sin1 = _product(wave, p + j + _STRIDE, m + j + _STRIDE)
                    cos2, sin2 = _product(wave, p + j + _TWICE, m + j + _TWICE)
                    cos3, sin3 = _product(wave, p + j + _THRICE, m + j + _THRICE)
                    total[j] += (a0 * cos0 + a1 * cos1) + (a2 * cos2 + a3 * cos3)
                    total[j + np.uintp(_WIDE)] += (b0 * cos0 + b1 * cos1) + (b2 * cos2 + b3 * cos3)
                    total[j + np.uintp(2 * _WIDE)] += (c0 * cos0 + c1 * cos1) + (c2 * cos2 + c3 * cos3)
                    total[j + np.uintp(3 * _WIDE)] += (d0 * cos0 + d1 * cos1) + (d2 * cos2 + d3 * cos3)
                    total[j + np.uintp(4 * _WIDE)] += (a0 * sin0 + a1 * sin1) + (a2 * sin2 + a3 * sin3)
                    total[j + np.uintp(5 * _WIDE)] += (b0 * sin0 + b1 * sin1) + (b2 * sin2 + b3 * sin3)
                    total[j + np.uintp(6 * _WIDE)] += (c0 * sin0 + c1 * sin1) + (c2 * sin2 + c3 * sin3)
                    total[j + np.uintp(7 * _WIDE)] += (d0 * sin0 + d1 * sin1) + (d2 * sin2 + d3 * sin3)
                p, m = p + _FOUR, m + _FOUR
            for part in range(8):
                for column in range(columns):
                    sums[part, row, column] += total[part * _WIDE + column]
