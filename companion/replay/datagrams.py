"""Datagrams of a log, for a replay: signed anew, since a replay has no robot's keys, and those of versions 2 and 3 said
again as they are said now. On the air only the present version is taken.
"""

from __future__ import annotations

import struct
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.neighbours import wire
from wsr.reduced import COEFFICIENTS

_HEADER: Final = struct.Struct("<4sBBHQQqBBBBiiiIII")
_POSE: Final = np.dtype([("age", "<u2"), ("dp", "<i2", (3,))])
_CSI: Final = np.dtype(
    [
        ("frame", "u1"),
        ("nic", "u1", (3,)),
        ("scale", "u1"),
        ("power", "i1"),
        ("coefficients", "u1", (COEFFICIENTS * 2 * 6 // 8,)),
    ]
)
_METRES_PER_UNIT: Final = 1e-4
_NS_PER_AGE: Final = 100_000
_NIC_BITS: Final = 22


def resigned(data: bytes, key: bytes) -> bytes:
    """A datagram whose signature was checked when it arrived. Raises WireError for version 2 cut short."""
    if data[4:5] == b"\x02":
        return wire.encode(_version_2(data[: -wire.TAG_BYTES]), key)
    return wire.signed_anew(data, key)


def _version_2(body: bytes) -> wire.Datagram:
    """Header, then a row of 8 bytes for each pose and one of 18 for each channel."""
    try:
        (_, _, role, sender, boot_id, counter, sent_ns, n_poses, n_csi, flags, _, *base, frame, nic_us, age_us) = (
            _HEADER.unpack_from(body)
        )
        pose_rows = np.frombuffer(body, _POSE, n_poses, _HEADER.size)
        csi_rows = np.frombuffer(body, _CSI, n_csi, _HEADER.size + pose_rows.nbytes)
    except (struct.error, ValueError) as error:
        raise wire.WireError(f"{len(body)} bytes of version 2: {error}") from None
    nic = csi_rows["nic"].astype(np.int64) @ np.array([1, 1 << 8, 1 << 16])
    later_us = nic & ((1 << _NIC_BITS) - 1)
    return wire.Datagram(
        role=wire.Role(role),
        sender=sender,
        boot_id=boot_id,
        counter=counter,
        sent_ns=sent_ns,
        poses=wire.PoseBatch(
            sent_ns - (pose_rows["age"] >> 2).astype(np.int64) * _NS_PER_AGE,
            (np.array(base) + pose_rows["dp"]) * _METRES_PER_UNIT,
            (pose_rows["age"] & 3).astype(np.uint8),
        ),
        csi=wire.CsiBatch(
            frame=(frame + csi_rows["frame"].astype(np.int64)).astype(np.uint32),
            t_ns=sent_ns + (later_us - age_us) * 1000,
            nic_us=(nic_us + later_us).astype(np.uint32),
            coefficients=_coefficients(csi_rows["coefficients"]),
            scale=csi_rows["scale"].copy(),
            power_dbm=csi_rows["power"].copy(),
            antenna=(nic >> _NIC_BITS).astype(np.uint8),
        ),
        counted=bool(flags & 1),
    )


def _coefficients(packed: npt.NDArray[np.uint8]) -> npt.NDArray[np.int8]:
    fours = packed.reshape(-1, 3).astype(np.int32) @ np.array([1, 1 << 8, 1 << 16])
    parts = (fours[:, np.newaxis] >> np.array([0, 6, 12, 18]) & 63) - 32
    return np.asarray(parts.reshape(len(packed), COEFFICIENTS, 2), np.int8)
