"""A recorded run from physics, in the layout of the WSR data sets: exchanges with one transmitter of known place."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from csi_bridge.records import CsiRecord
from tests.csi_records import log_of
from wsr.channel import wavelength_m
from wsr.ofdm import INDICES_5300_20MHZ

STAMP = "2026-01-02_030405"
RX_MAC = "00:21:6A:53:89:D2"
TX_MAC = "00:21:6A:3F:17:5A"
CHANNEL = 108
START_S = 1_700_000_000.0
EXCHANGES = 500
SECONDS = 4.0

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RunFolder:
    folder: Path

    @property
    def rx(self) -> Path:
        return self.folder / f"csi_rx_{STAMP}.dat"

    @property
    def tx(self) -> Path:
        return self.folder / f"csi_tx2_{STAMP}.dat"

    @property
    def trajectory(self) -> Path:
        return self.folder / f"rx_trajectory_{STAMP}_.csv"

    @property
    def truth(self) -> Path:
        return self.folder / "groundtruth_positions.json"


def path_m(t_s: Array, flat: bool = False) -> Array:
    """Two turns of a circle of 0.25 m, climbing 0.4 m unless flat; (N, 3)."""
    angle = 4 * np.pi * t_s / SECONDS
    height = np.zeros_like(t_s) if flat else 0.4 * t_s / SECONDS
    return np.stack([0.25 * np.cos(angle) + 1.0, 0.25 * np.sin(angle) - 2.0, 0.3 + height], axis=1)


def write_run(
    folder: Path,
    p_tx_m: tuple[float, float, float],
    layout: int = 38,
    flat: bool = False,
    tx_moves_m: Callable[[Array], Array] | None = None,
    tx_clock_s: float = 0.0,
) -> RunFolder:
    """Writes all files of a run; the answers come 0.3 ms after the pings. `tx_moves_m` gives the transmitter's way
    (N, 3) from `p_tx_m` at times (N,); its host's clock is `tx_clock_s` ahead."""
    files = RunFolder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(3)
    t_s = np.linspace(0.1, SECONDS - 0.1, EXCHANGES)
    way_m = np.zeros((EXCHANGES, 3)) if tx_moves_m is None else tx_moves_m(t_s)
    distance_m = np.linalg.norm(path_m(t_s, flat) - np.array(p_tx_m) - way_m, axis=1)
    one_way = np.exp(-2j * np.pi * distance_m / wavelength_m(CHANNEL))
    oscillators = np.exp(2j * np.pi * rng.random(EXCHANGES))
    answers = [
        _record(n, t_s[n] + 3e-4, TX_MAC, one_way[n] * oscillators[n], layout=layout, rng=rng) for n in range(EXCHANGES)
    ]
    pings = [
        _record(n, t_s[n], RX_MAC, one_way[n] / oscillators[n], layout=layout, rng=rng, clock_s=tx_clock_s)
        for n in range(EXCHANGES)
    ]
    files.rx.write_bytes(log_of(answers) + log_of(answers[:1])[:40])
    files.tx.write_bytes(log_of(pings))
    pose_t_s = np.arange(0.0, SECONDS, 0.01)
    rows = [(START_S + t, 0.0, *p) for t, p in zip(pose_t_s, path_m(pose_t_s, flat), strict=True)]
    files.trajectory.write_text("".join(",".join(f"{value:.6f}" for value in row) + ",\n" for row in rows))
    places = {"tx2": dict(zip("xyz", p_tx_m, strict=True)), "tx3": dict.fromkeys("xyz", 0)}
    truth = {
        "channel": {"value": CHANNEL},
        "true_tx_positions": {"value": {name: {"position": place} for name, place in places.items()}},
    }
    files.truth.write_text(json.dumps(truth))
    return files


def _record(
    number: int,
    t_s: float,
    mac: str,
    channel: complex,
    *,
    layout: int,
    rng: np.random.Generator,
    clock_s: float = 0.0,
) -> CsiRecord:
    delay = np.exp(1j * rng.uniform(-0.3, 0.3) * INDICES_5300_20MHZ)
    csi = np.zeros((30, 3, 1), np.complex128)
    # Antenna B has the signal, the others a count of noise.
    csi[:, 1, 0] = 50 * channel * delay
    csi += rng.normal(0, 1, (30, 3, 1)) + 1j * rng.normal(0, 1, (30, 3, 1))
    return CsiRecord(
        timestamp_low_us=(round(t_s * 1e6) + 4_290_000_000) % (1 << 32),
        bfee_count=number % 65536,
        n_rx=3,
        n_tx=1,
        rssi=(10, 40, 10),
        noise_dbm=-90,
        agc=30,
        antenna_sel=0b00_10_01,
        rate=0x101,
        csi=np.round(csi.real).astype(np.complex64) + 1j * np.round(csi.imag).astype(np.complex64),
        layout=layout,
        host_time_ns=round((START_S + t_s + clock_s) * 1e6) * 1000,
        mac=bytes.fromhex(mac.replace(":", "")),
        frame_count=number + 1 if layout == 38 else None,
    )
