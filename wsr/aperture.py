"""The synthetic aperture: what every estimator takes, checked when it is built."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wsr.displacement import relative_displacement
from wsr.errors import ApertureError
from wsr.ofdm import GRID_5300, Grid, grid, known

MIN_PACKETS = 20
MIN_LENGTH_WAVELENGTHS = 2.0

# An axis counts as sampled when the packets spread over it far enough that mirroring it would show: over half a
# wavelength the mirror image of a source on that axis is gone. The share keeps the drift of a long flat path,
# which pose sources show as a few percent of its length, from passing as a third dimension.
_MIN_EXTENT_WAVELENGTHS = 0.5
_MIN_EXTENT_SHARE = 0.03

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Aperture:
    """Packets of one transmitter over one stretch of motion, world axes ENU.

    t_s (M,) float64, not decreasing; chi_m (M, 3) float64, the displacement p_i - p_j about its mean; channel (M,)
    complex128, the round-trip product h_fwd * h_rev; reference_p_m the mean position of our own antenna, which the
    bearing is taken from; reference_t_s the mean time. Raises ApertureError when built from anything else.

    What an estimator may use beyond that, where the recording or the link has it: forward and reverse (M, S) complex64,
    the channels of both directions over S subcarriers, and nic_us (M, 2) float64, the unwrapped microsecond stamps of
    our card and of the other's for each exchange. subcarrier_hz (S,) are the frequencies of the subcarriers from the
    channel's centre; without them 30 are those of an Intel 5300 at 20 MHz, and a single one is the centre. half_turns:
    each end's receive chain may turn by half a turn from packet to packet, as an AX card's does.
    """

    t_s: Array
    chi_m: Array
    channel: NDArray[np.complex128]
    wavelength_m: float
    reference_p_m: tuple[float, float, float]
    reference_t_s: float
    forward: NDArray[np.complex64] | None = None
    reverse: NDArray[np.complex64] | None = None
    nic_us: Array | None = None
    subcarrier_hz: Array | None = None
    half_turns: bool = False
    _known_spread: list[tuple[Array, tuple[float, float, float]]] = field(default_factory=list, init=False, repr=False)
    """The principal axes and the extents along them, once they were asked for: estimators ask ten times."""

    def __post_init__(self) -> None:
        for name, array, shape in (
            ("t_s", np.array(self.t_s, np.float64), ()),
            ("chi_m", np.array(self.chi_m, np.float64), (3,)),
            ("channel", np.array(self.channel, np.complex128), ()),
        ):
            if array.shape[1:] != shape or array.ndim != 1 + len(shape) or array.shape[0] != len(self.t_s):
                raise ApertureError(f"{name} has shape {array.shape}; expected {(len(self.t_s), *shape)}")
            bad = int(np.count_nonzero(~np.isfinite(array)))
            if bad:
                raise ApertureError(f"{name} has {bad} values that are not finite; expected none")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        self._check_optional()
        if self.packets == 0:
            raise ApertureError("aperture has 0 packets; expected at least 1")
        if not np.any(self.channel):
            raise ApertureError("channel is zero in every packet; expected a signal")
        if np.any(np.diff(self.t_s) < 0):
            raise ApertureError("t_s decreases; expected packets in the order of time")
        if not (math.isfinite(self.wavelength_m) and self.wavelength_m > 0):
            raise ApertureError(f"wavelength_m is {self.wavelength_m}; expected a positive length")

    def _check_optional(self) -> None:
        for name in ("forward", "reverse", "nic_us"):
            given = getattr(self, name)
            if given is None:
                continue
            # A copy that cannot be written, like the others: one kind of array, one specialisation of the kernels.
            array = np.array(given, np.float64 if name == "nic_us" else np.complex64, order="C")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
            if array.ndim != 2 or array.shape[0] != self.packets or (name == "nic_us" and array.shape[1] != 2):
                raise ApertureError(
                    f"{name} has shape {array.shape}; expected a row for each of {self.packets} packets"
                )
            if not np.isfinite(array).all():
                raise ApertureError(f"{name} has values that are not finite; expected none")
        if (self.forward is None) != (self.reverse is None):
            raise ApertureError("of forward and reverse only one is given; expected both or neither")
        if self.forward is None or self.reverse is None:
            return
        # The kernels index both alike, and know the place of each subcarrier, unchecked.
        ours, theirs = self.forward.shape[1], self.reverse.shape[1]
        try:
            given = None if self.subcarrier_hz is None else grid(self.subcarrier_hz)
        except ValueError as error:
            raise ApertureError(str(error)) from None
        wanted = (GRID_5300.size, 1) if given is None else (given.size,)
        if ours != theirs or ours not in wanted:
            expected = (
                f"{' or '.join(map(str, wanted))} of both, as their frequencies are {'' if given else 'not '}given"
            )
            raise ApertureError(f"forward has {ours} subcarriers and reverse {theirs}; expected {expected}")

    @property
    def grid(self) -> Grid:
        """Of forward and reverse; of one subcarrier, the centre, where they are not given."""
        if self.forward is None:
            return known(1)
        return known(self.forward.shape[1], None if self.subcarrier_hz is None else grid(self.subcarrier_hz))

    @property
    def packets(self) -> int:
        """Number of packets M."""
        return int(self.t_s.size)

    @property
    def length_m(self) -> float:
        """Length of the path through the packets, in metres; jitter of the poses counts into it."""
        return float(np.linalg.norm(np.diff(self.chi_m, axis=0), axis=-1).sum())

    @property
    def principal_axes(self) -> Array:
        """Unit vectors (3, 3), one per row, along which the packets spread most, less, least. Raises ApertureError."""
        return self._spread()[0]

    @property
    def extents_m(self) -> tuple[float, float, float]:
        """Lengths of the aperture along its principal axes, longest first, in metres."""
        return self._spread()[1]

    def _spread(self) -> tuple[Array, tuple[float, float, float]]:
        if self._known_spread:
            return self._known_spread[0]
        with np.errstate(over="ignore", invalid="ignore"):
            scatter = self.chi_m.T @ self.chi_m
        try:
            axes = np.asarray(np.linalg.svd(scatter)[2])
        except np.linalg.LinAlgError:
            raise ApertureError(f"chi_m reaches {np.abs(self.chi_m).max():.3g} m, too far to have axes") from None
        shortest, middle, longest = sorted(spans(self.chi_m, axes).tolist())
        self._known_spread.append((axes, (longest, middle, shortest)))
        return self._known_spread[0]

    @property
    def dimension(self) -> int:
        """1 straight (bearings on a cone), 2 planar (a bearing and its mirror image), 3 spatial (one bearing)."""
        longest, *others = self.extents_m
        least = max(_MIN_EXTENT_WAVELENGTHS * self.wavelength_m, _MIN_EXTENT_SHARE * longest)
        return 1 + sum(extent > least for extent in others)


def spans(p_m: Array, axes: Array) -> Array:
    """Lengths (3,) over which positions (M, 3) spread along the unit vectors in the rows of `axes` (3, 3)."""
    along = axes @ p_m.T
    return np.asarray(along.max(axis=1) - along.min(axis=1))


def make_aperture(
    t_s: ArrayLike,
    p_i_m: ArrayLike,
    channel: ArrayLike,
    wavelength_m: float,
    *,
    p_j_m: ArrayLike | None = None,
    min_packets: int = MIN_PACKETS,
    min_length_m: float | None = None,
    forward: NDArray[np.complex64] | None = None,
    reverse: NDArray[np.complex64] | None = None,
    nic_us: Array | None = None,
    subcarrier_hz: Array | None = None,
    half_turns: bool = False,
) -> Aperture:
    """Aperture from packet times (M,) in s, antenna positions (M, 3) in m and round-trip channels (M,).

    `p_j_m` (M, 3) are the other end's antenna positions in the same axes (its origin is free), None if it stands
    still. Packets may come in any order. Raises ApertureError on values that are not finite, on fewer than
    `min_packets` packets, on fewer different places than that (a tracker that repeats itself), and when the packets
    lie within less than `min_length_m` (two wavelengths if not given).
    The length here is the longest extent, not the path, because the jitter of a hovering vehicle lengthens the path.
    """
    times = np.asarray(t_s, np.float64)
    positions = np.asarray(p_i_m, np.float64)
    others = None if p_j_m is None else np.asarray(p_j_m, np.float64)
    values = np.asarray(channel, np.complex128)
    if times.size < max(min_packets, 1):
        raise ApertureError(f"aperture has {times.size} packets; needs at least {max(min_packets, 1)}")
    for name, array in (("p_i_m", positions), ("p_j_m", others)):
        if array is not None and array.shape != (times.size, 3):
            raise ApertureError(f"{name} has shape {array.shape}; expected {(times.size, 3)}")
        if array is not None and not np.isfinite(array).all():
            raise ApertureError(f"{name} is not finite in {int((~np.isfinite(array)).any(axis=1).sum())} packets")
    if values.shape != times.shape:
        raise ApertureError(f"channel has shape {values.shape}; expected {times.shape}")
    order = np.argsort(times, kind="stable")
    x, y, z = (float(value) for value in positions.mean(axis=0))
    aperture = Aperture(
        t_s=times[order],
        chi_m=relative_displacement(positions, others)[order],
        channel=values[order],
        wavelength_m=wavelength_m,
        reference_p_m=(x, y, z),
        reference_t_s=float(times.mean()),
        forward=None if forward is None else forward[order],
        reverse=None if reverse is None else reverse[order],
        nic_us=None if nic_us is None else nic_us[order],
        subcarrier_hz=subcarrier_hz,
        half_turns=half_turns,
    )
    needed = MIN_LENGTH_WAVELENGTHS * wavelength_m if min_length_m is None else min_length_m
    if aperture.extents_m[0] < needed:
        raise ApertureError(f"aperture spans {aperture.extents_m[0]:.3f} m; needs at least {needed:.3f} m")
    places = 1 + int(np.count_nonzero(np.any(np.diff(aperture.chi_m, axis=0) != 0.0, axis=1)))
    needed_places = min(max(min_packets, 1), MIN_PACKETS)
    if places < needed_places:
        raise ApertureError(f"aperture has {places} different places; needs at least {needed_places}")
    return aperture
