"""A card of your own: its measurements in the service's default format, to the socket of `csi.source: unix`."""

from __future__ import annotations

import socket
import sys
import time

import numpy as np
import numpy.typing as npt

from csi_bridge.connector import encode_message
from csi_bridge.encoder import encode_body
from csi_bridge.records import CSI_CODE, SUBCARRIERS, CsiRecord
from csi_bridge.unix_socket import UNIX_CONNECTOR_IDX

LAYOUT_WITH_COUNTER = 38
HT_20_MHZ = 257
ANTENNA_A = 0


def record(
    channel: npt.NDArray[np.complex128], card_us: int, frame: int, mac: bytes, power_dbm: int, number: int
) -> CsiRecord:
    """Of one packet on one antenna: `channel` (30,) as measured. The format holds 8 bits for each part, so it is
    scaled; what was received stands in rssi and agc: dBm = rssi - 44 - agc."""
    scaled = np.round(channel / np.abs(channel).max() * 60)
    return CsiRecord(
        timestamp_low_us=card_us % 2**32,
        bfee_count=number % 2**16,
        n_rx=1,
        n_tx=1,
        rssi=(power_dbm + 44 + 40, 0, 0),
        noise_dbm=-92,
        agc=40,
        antenna_sel=ANTENNA_A,
        rate=HT_20_MHZ,
        csi=scaled.astype(np.complex64).reshape(SUBCARRIERS, 1, 1),
        layout=LAYOUT_WITH_COUNTER,
        host_time_ns=time.time_ns(),
        mac=mac,
        frame_count=frame,
    )


def message(one: CsiRecord) -> bytes:
    """The datagram in which a driver reports it."""
    return encode_message(UNIX_CONNECTOR_IDX, CSI_CODE, encode_body(one))


def main(path: str) -> None:
    rng = np.random.default_rng(1)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.connect(path)
        for number in range(10):
            channel = np.exp(1j * rng.uniform(0, 0.5, SUBCARRIERS))
            one = record(channel, 10_000 * number, number, bytes.fromhex("00216A3F175A"), -50, number)
            sock.send(message(one))
            time.sleep(0.01)


if __name__ == "__main__":
    main(sys.argv[1])
