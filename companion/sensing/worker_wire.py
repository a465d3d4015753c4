"""What passes between the service and its AOA worker: length-prefixed msgpack on pipes."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from wsr.aoa import AoaEstimate
from wsr.aperture import Aperture
from wsr.crb.informativeness import Informativeness

LENGTH = struct.Struct("<I")
MAX_BYTES = 64 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class AoaRequest:
    """One aperture: `t_s` (M,) f64, `chi_m` (M, 3) f64 and `channel` (M,) c128 as their bytes."""

    id: int
    peer: int
    t_s: bytes
    chi_m: bytes
    channel: bytes
    wavelength_m: float
    reference_p_m: tuple[float, float, float]
    reference_t_s: float
    forward: bytes = b""
    """(M, S) c64, or nothing; `reverse` likewise."""
    reverse: bytes = b""
    nic_us: bytes = b""
    """(M, 2) f64, or nothing."""
    subcarrier_hz: bytes = b""
    """(S,) f64, or nothing."""
    half_turns: bool = False


READY_ID = -1
"""Id of the empty result that says that requests are welcome: the first of a worker, whose kernel is compiled then, and
the answer to SIGN_OF_LIFE."""
SIGN_OF_LIFE = AoaRequest(
    id=READY_ID, peer=0, t_s=b"", chi_m=b"", channel=b"", wavelength_m=0.0, reference_p_m=(0.0,) * 3, reference_t_s=0.0
)


@dataclass(frozen=True, slots=True, kw_only=True)
class AoaResult:
    """The answer to one request: an estimate with its profile (180, 360) as float16 bytes, or a refusal."""

    id: int
    peer: int
    compute_s: float
    estimate: AoaEstimate | None = None
    profile: bytes = b""
    refusal: str = ""
    informativeness: Informativeness | None = None
    """What the aperture tells, towards the estimate and in the worst case; None for a refusal."""
    failed: bool = False
    """The worker was lost or behind: the refusal is no judgement of the aperture."""


def request_of(request_id: int, peer: int, aperture: Aperture) -> AoaRequest:
    return AoaRequest(
        id=request_id,
        peer=peer,
        t_s=np.ascontiguousarray(aperture.t_s, np.float64).tobytes(),
        chi_m=np.ascontiguousarray(aperture.chi_m, np.float64).tobytes(),
        channel=np.ascontiguousarray(aperture.channel, np.complex128).tobytes(),
        wavelength_m=aperture.wavelength_m,
        reference_p_m=aperture.reference_p_m,
        reference_t_s=aperture.reference_t_s,
        forward=_bytes(aperture.forward),
        reverse=_bytes(aperture.reverse),
        nic_us=_bytes(aperture.nic_us),
        subcarrier_hz=b""
        if aperture.subcarrier_hz is None
        else np.asarray(aperture.subcarrier_hz, np.float64).tobytes(),
        half_turns=aperture.half_turns,
    )


def aperture_of(request: AoaRequest) -> Aperture:
    """Raises ApertureError as `Aperture` does."""
    t_s = np.frombuffer(request.t_s)
    return Aperture(
        t_s=t_s,
        chi_m=np.frombuffer(request.chi_m).reshape(-1, 3),
        channel=np.frombuffer(request.channel, np.complex128),
        wavelength_m=request.wavelength_m,
        reference_p_m=request.reference_p_m,
        reference_t_s=request.reference_t_s,
        forward=_array(request.forward, np.complex64, len(t_s)),
        reverse=_array(request.reverse, np.complex64, len(t_s)),
        nic_us=_array(request.nic_us, np.float64, len(t_s)),
        subcarrier_hz=np.frombuffer(request.subcarrier_hz) if request.subcarrier_hz else None,
        half_turns=request.half_turns,
    )


def frame(message: AoaRequest | AoaResult) -> bytes:
    body = msgspec.msgpack.encode(message)
    return LENGTH.pack(len(body)) + body


def _bytes(array: npt.NDArray[Any] | None) -> bytes:
    return b"" if array is None else np.ascontiguousarray(array).tobytes()


def _array(data: bytes, dtype: type[np.generic], rows: int) -> npt.NDArray[Any] | None:
    return np.frombuffer(data, dtype).reshape(rows, -1) if data else None
