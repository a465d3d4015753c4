"""Channel centres of packets, each computed once: apertures that slide along a path share most of theirs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from wsr.channel import centre_channel
from wsr.ofdm import Grid

Stamps = npt.NDArray[np.int64]
Csi = npt.NDArray[np.complex64]
Complex = npt.NDArray[np.complex128]


class Centres:
    """Remembers the centres of the newest aperture. Each is that of its packet alone, whatever others are with it."""

    def __init__(self) -> None:
        self._grid: Grid | None = None
        self._stamps: Stamps = np.zeros(0, np.int64)
        self._csi: Csi = np.zeros((0, 0), np.complex64)
        self._centres: Complex = np.zeros(0, np.complex128)

    def of(self, stamps: Stamps, csi: Csi, grid: Grid) -> Complex:
        """`wsr.channel.centre_channel` (M,) of CSI (M, S) on `grid`, of packets with these stamps (M,)."""
        known, at = self._known(stamps, csi, grid)
        centres = np.empty(len(csi), np.complex128)
        centres[known] = self._centres[at]
        if not known.all():
            centres[~known] = centre_channel(csi[~known], grid)
        order = np.argsort(stamps, kind="stable")
        self._grid, self._stamps, self._csi, self._centres = grid, stamps[order], csi[order], centres[order]
        return centres

    def _known(self, stamps: Stamps, csi: Csi, grid: Grid) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.intp]]:
        """Which packets (M,) are remembered, and where. Stamps come again; a packet is known by what it brought."""
        if grid is not self._grid or not len(self._stamps) or csi.shape[1] != self._csi.shape[1]:
            return np.zeros(len(csi), np.bool_), np.zeros(0, np.intp)
        at = np.minimum(self._stamps.searchsorted(stamps), len(self._stamps) - 1)
        known = (self._stamps[at] == stamps) & (self._csi[at] == csi).all(axis=1)
        return known, at[known]
