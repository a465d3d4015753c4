"""Receive chains whose sign is random: an AX card turns each chain by half a turn, or not, from packet to packet.

One chain is used at each end, and its sign is left. The half phase of H_f H_r^* then is off by quarter turns, and
h^2 = +-H_f H_r: the one-way channel has four roots where it has two otherwise. They are chained from packet to packet
like the two.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wsr.aperture import Aperture
from wsr.first_path import first_path, is_wide
from wsr.ofdm import known
from wsr.reciprocity import ChainLimits, chain_quarters, fold, without_delay
from wsr.turnaround import carrier_offset_hz, jitter_s

_FAR_WAVELENGTHS, _NEAR_WAVELENGTHS = 1 / 3, 1 / 12

Array = NDArray[np.float64]


def without_half_turns(aperture: Aperture) -> Aperture:
    """The aperture with the forward channel, and so the product, of the sign that lets the one-way channel go on from
    packet to packet; the same one where there are no half turns. Where packets are too far apart to tell, the likelier
    root is taken. Without channels of both directions nothing can be told, and they stay.
    """
    if not aperture.half_turns:
        return aperture
    if aperture.forward is None or aperture.reverse is None:
        return replace(aperture, half_turns=False)
    folded = fold(aperture.forward, aperture.reverse, aperture.grid)
    field, on = without_delay(folded.channel, half_jitter_rad(aperture, folded.centre), aperture.grid), aperture.grid
    if is_wide(on):
        # Where echoes fade, all paths together do not tell the roots; the first one alone does.
        field, on = first_path(field, on), known(1)
    wave_m = aperture.wavelength_m
    limits = ChainLimits(_FAR_WAVELENGTHS * wave_m, _NEAR_WAVELENGTHS * wave_m, gate=False)
    clock_s = aperture.t_s if aperture.nic_us is None else (aperture.nic_us[:, 0] - aperture.nic_us[0, 0]) * 1e-6
    quarters = chain_quarters(field, clock_s, aperture.chi_m, limits, grid=on)[0]
    # h turned by n quarters is h^2 times (-1)^n, which is a sign of one of both ends.
    sign = np.where(quarters % 2 == 0, 1.0, -1.0)
    return replace(
        aperture,
        channel=aperture.channel * sign,
        forward=np.asarray(aperture.forward * sign[:, None], np.complex64),
        half_turns=False,
    )


def half_jitter_rad(aperture: Aperture, product: NDArray[np.complexfloating]) -> Array:
    """pi df dt (M,), which undoes the turnaround jitter of the one-way channel. df comes from the squared product, in
    which no sign is left; its carriers are at twice the frequency."""
    if aperture.nic_us is None:
        return np.zeros(aperture.packets)
    ours_s = (aperture.nic_us[:, 0] - aperture.nic_us[0, 0]) * 1e-6
    turnaround_s = (aperture.nic_us[:, 1] - aperture.nic_us[:, 0]) * 1e-6
    twice_hz = carrier_offset_hz(np.square(product), turnaround_s, ours_s, aperture.wavelength_m / 2)
    late_s = jitter_s(turnaround_s, ours_s, twice_hz / 2, aperture.wavelength_m)
    return np.asarray(math.pi * twice_hz / 2 * late_s)
