"""A recording to try things with: a simulated run in the layout of the public WSR data sets, for a clone that has none.

The drone flies a climbing circle, as with motion capture; the radio is the simulator's, in the scene of the hall.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal

import numpy as np

from companion.errors import CompanionError
from companion.log.export import refuse_other_content
from companion.sim.ax_radio import simulate_ax_exchanges
from companion.sim.radio import DEFAULT_EPOCH_NS, simulate_exchanges
from companion.sim.scenario import Scenario, ax210_radio, bare_robot
from companion.sim.scenes import set_in
from companion.sim.trajectory import Array, Trajectory
from csi_bridge.encoder import encode_body, encode_file_record
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.records import CSI_CODE, CsiRecord

RX_MAC: Final = "00:21:6A:53:89:D2"
TX_MAC: Final = "00:21:6A:3F:17:5A"
_STAMP: Final = "2023-11-14_221320"
_LOGS: Final = frozenset({".dat", ".csi"})
_SECONDS: Final = 6.0
_START_S: Final = 1.0
_RADIUS_M: Final = 0.3
_TURNS: Final = 2.0
_HEIGHT_M: Final = 1.2
_CLIMB_M: Final = 0.5
_DISTANCE_M: Final = 8.0
_RATE_HZ: Final = 100.0


def write_sample(folder: Path, seed: int, width_mhz: Literal[20, 40, 80, 160] | None = None) -> tuple[float, float]:
    """Logs of both ends, the trajectory and the truth; the true azimuth and elevation [deg]. With a width the cards are
    AX210s. All files are written or none. Raises CompanionError where the folder cannot be written, where a file of
    other content is there, and where it holds the log of another run, whose truth this would pass for."""
    world = _world(seed)
    assert world.beacon_azimuth_rad is not None
    place_m = _DISTANCE_M * np.array([math.cos(world.beacon_azimuth_rad), math.sin(world.beacon_azimuth_rad), 0.0])
    place_m[2] = 0.5
    uav = _flown()
    beacon = Trajectory(uav.t_s[[0, -1]], np.tile(place_m, (2, 1)), np.zeros(2))
    if width_mhz is None:
        logs = [_log(records) for records in simulate_exchanges(world, uav, beacon)]
    else:
        wide = replace(world, radio=ax210_radio(world.radio, width_mhz))
        at_ends = simulate_ax_exchanges(wide, uav, beacon, host_stamps=True)
        logs = [b"".join(map(encode_record, records)) for records in at_ends]
    suffix = "dat" if width_mhz is None else "csi"
    start_s = DEFAULT_EPOCH_NS / 1e9
    rows = [(start_s + t, 0.0, *p) for t, p in zip(uav.t_s, uav.p_enu_m, strict=True)]
    place = dict(zip("xyz", place_m.tolist(), strict=True))
    truth = {
        "channel": {"value": world.radio.channel},
        "true_tx_positions": {"value": {"tx2": {"position": place}}},
    }
    files = {f"csi_{end}_{_STAMP}.{suffix}": log for end, log in zip(("rx", "tx2"), logs, strict=True)}
    files[f"rx_trajectory_{_STAMP}_.csv"] = "".join(
        ",".join(f"{value:.6f}" for value in row) + ",\n" for row in rows
    ).encode()
    files["groundtruth_positions.json"] = (json.dumps(truth, indent=2) + "\n").encode()
    try:
        _write(folder, files)
    except OSError as error:
        raise CompanionError(f"{folder}: cannot write the recording: {error.strerror or error}") from None
    away_m = place_m - uav.p_enu_m.mean(axis=0)
    return math.degrees(math.atan2(away_m[1], away_m[0])), math.degrees(
        math.atan2(away_m[2], math.hypot(away_m[0], away_m[1]))
    )


def _write(folder: Path, files: Mapping[str, bytes]) -> None:
    """Raises OSError and CompanionError; then nothing of it is there."""
    others = (path for path in sorted(folder.glob("csi_*")) if path.suffix in _LOGS and path.name not in files)
    for path in others:
        raise CompanionError(f"{path}: is there already, the log of another run; choose another folder")
    refuse_other_content({folder / name: content for name, content in files.items()})
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(prefix=".", dir=folder) as staging:
            written = [Path(staging, name) for name in files]
            for path, content in zip(written, files.values(), strict=True):
                path.write_bytes(content)
            for path in written:
                path.replace(folder / path.name)
    finally:
        if made and not any(folder.iterdir()):
            folder.rmdir()


def _world(seed: int) -> Scenario:
    rng = np.random.default_rng([seed, 11])
    base = Scenario(
        seed=seed,
        uav=bare_robot("uav", RX_MAC, float(rng.uniform(-2, 2)), 0.0),
        beacon=bare_robot("beacon", TX_MAC, float(rng.uniform(-2, 2)), 0.4),
        truth_in="none",
        truth_out="none",
        beacon_azimuth_rad=float(rng.uniform(-math.pi, math.pi)),
    )
    return set_in(base, "hall")


def _flown() -> Trajectory:
    t_s: Array = _START_S + np.arange(0.0, _SECONDS, 1 / _RATE_HZ)
    angle = math.tau * _TURNS * (t_s - _START_S) / _SECONDS
    up_m = _HEIGHT_M + _CLIMB_M * (t_s - _START_S) / _SECONDS
    p_enu_m = np.stack([_RADIUS_M * np.cos(angle), _RADIUS_M * np.sin(angle), up_m], axis=1)
    return Trajectory(t_s, p_enu_m, np.zeros(len(t_s)))


def _log(records: list[CsiRecord]) -> bytes:
    return b"".join(encode_file_record(CSI_CODE, encode_body(record)) for record in records)
