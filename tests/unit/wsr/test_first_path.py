"""The first path of wide channels: told from echoes 2 to 4 m longer, whatever each packet's own delay."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from wsr.first_path import first_path, is_wide
from wsr.ofdm import GRID_5300, Grid, grid

LIGHT_M_S = 299_792_458.0
PACKETS = 200

Complex = npt.NDArray[np.complex128]


def grid_of(width_mhz: int) -> Grid:
    half = 0.485e6 * width_mhz
    return grid(np.arange(-half, half, 625e3))


def seen(
    on: Grid, longer_m: float, louder_db: float, rng: np.random.Generator, noise: float = 0.03
) -> tuple[npt.NDArray[np.complex64], Complex]:
    """Channels (M, S) of a path and an echo, whose phases turn at different rates along the way, about their power
    centroids and with noise; and the path's own value (M,)."""
    along = np.arange(PACKETS)
    direct, echo = np.exp(0.35j * along), 10 ** (louder_db / 20) * np.exp(-0.21j * along + 1.0j)
    channel = direct[:, None] + echo[:, None] * np.exp(-2j * np.pi * on.hz * longer_m / LIGHT_M_S)
    lagged = (channel[:, on.second] * channel[:, on.first].conj()).sum(axis=1)
    off_s = rng.normal(0.0, 1e-9, PACKETS)
    slope = np.angle(lagged)[:, None] / on.lag * on.k + 2 * np.pi * on.hz * off_s[:, None]
    white = rng.normal(size=(2, PACKETS, on.size)) * noise
    return np.asarray(channel * np.exp(-1j * slope) + white[0] + 1j * white[1], np.complex64), direct


def likeness(values: Complex, path: Complex) -> float:
    turned = values / np.abs(values) * path.conj()
    return float(abs(turned.mean()))


@pytest.mark.parametrize(
    ("width_mhz", "longer_m"), [(40, 8.0), (40, 15.0), (80, 4.0), (80, 12.0), (160, 2.0), (160, 4.0)]
)
@pytest.mark.parametrize("louder_db", [-3.0, 4.0])
def test_the_first_path_is_told_from_one_that_is_longer(width_mhz: int, longer_m: float, louder_db: float) -> None:
    on = grid_of(width_mhz)
    channel, direct = seen(on, longer_m, louder_db, np.random.default_rng(1))
    found = likeness(first_path(channel, on)[:, 0].astype(np.complex128), direct)
    together = likeness(channel.mean(axis=1).astype(np.complex128), direct)
    assert found > 0.9
    assert found > together + 0.02


def test_an_echo_that_fades_for_a_while_moves_nothing() -> None:
    on = grid_of(80)
    rng = np.random.default_rng(2)
    channel, direct = seen(on, 15.0, 4.0, rng)
    quiet, _ = seen(on, 15.0, -8.0, rng)
    channel[60:120] = quiet[60:120]
    assert likeness(first_path(channel, on)[:, 0].astype(np.complex128), direct) > 0.95


def test_one_path_alone_keeps_its_phase_and_noise_alone_does_no_harm() -> None:
    on = grid_of(160)
    rng = np.random.default_rng(3)
    channel, direct = seen(on, 30.0, -60.0, rng, noise=0.3)
    assert likeness(first_path(channel, on)[:, 0].astype(np.complex128), direct) > 0.98
    white = (rng.normal(size=(PACKETS, on.size)) + 1j * rng.normal(size=(PACKETS, on.size))).astype(np.complex64)
    assert np.isfinite(first_path(white, on)).all()
    assert np.isfinite(first_path(np.zeros_like(white), on)).all()


def test_narrow_bands_are_left_alone() -> None:
    assert [is_wide(on) for on in (GRID_5300, grid_of(40), grid_of(80), grid_of(160))] == [False, True, True, True]
