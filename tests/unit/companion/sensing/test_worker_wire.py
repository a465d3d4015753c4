"""What passes between the service and its AOA worker comes out as it went in."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from companion.sensing.worker_wire import LENGTH, READY_ID, SIGN_OF_LIFE, AoaRequest, aperture_of, frame, request_of
from wsr.aperture import Aperture
from wsr.errors import ApertureError

T_S = np.linspace(0.0, 1.0, 40)
PLAIN = Aperture(
    t_s=T_S,
    chi_m=np.stack([np.cos(5 * T_S), np.sin(5 * T_S), 0.1 * T_S], axis=1),
    channel=np.exp(1j * T_S),
    wavelength_m=0.054,
    reference_p_m=(1.0, 2.0, 3.0),
    reference_t_s=0.5,
)
WAVE = (np.ones((40, 30)) + 1j * T_S[:, None]).astype(np.complex64)
WHOLE = replace(
    PLAIN, forward=WAVE, reverse=WAVE[::-1].copy(), nic_us=np.stack([1e6 * T_S, 1e6 * T_S + 300], axis=1)
)  # fmt: skip
WIDE = replace(WHOLE, subcarrier_hz=312_500.0 * np.arange(-15.0, 15.0), half_turns=True)


@pytest.mark.parametrize("aperture", [PLAIN, WHOLE, WIDE], ids=["product alone", "5300", "AX"])
def test_an_aperture_comes_back_bit_for_bit(aperture: Aperture) -> None:
    data = frame(request_of(7, 2, aperture))
    (size,) = LENGTH.unpack_from(data)
    assert size == len(data) - LENGTH.size
    request = msgspec.msgpack.decode(data[LENGTH.size :], type=AoaRequest)
    assert (request.id, request.peer) == (7, 2)
    back = aperture_of(request)
    for name in ("t_s", "chi_m", "channel", "forward", "reverse", "nic_us", "subcarrier_hz"):
        ours, theirs = getattr(back, name), getattr(aperture, name)
        assert (ours is None) == (theirs is None), name
        assert ours is None or (ours.dtype == theirs.dtype and np.array_equal(ours, theirs)), name
    for name in ("wavelength_m", "reference_p_m", "reference_t_s", "half_turns"):
        assert getattr(back, name) == getattr(aperture, name)


def test_arrays_that_are_no_block_of_memory_are_sent_as_they_look() -> None:
    turned = replace(PLAIN, chi_m=np.asfortranarray(PLAIN.chi_m))
    np.testing.assert_array_equal(aperture_of(request_of(1, 2, turned)).chi_m, PLAIN.chi_m)


def test_a_sign_of_life_is_no_aperture() -> None:
    assert SIGN_OF_LIFE.id == READY_ID
    with pytest.raises(ApertureError):
        aperture_of(SIGN_OF_LIFE)
