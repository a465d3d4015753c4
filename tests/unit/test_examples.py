"""The examples of docs/extending.md do what their page says, with the service's own sources at the other end."""

from __future__ import annotations

import math
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.core.messages import Pose
from companion.pose.source import PoseSource
from csi_bridge.parser import parse_body
from csi_bridge.records import CsiRecord
from csi_bridge.unix_socket import UnixSource
from tests.paths import DOCS
from wsr.aperture import Aperture
from wsr.geometry import direction, great_circle

WAVELENGTH_M = 0.0541


def _example(name: str) -> dict[str, Any]:
    return runpy.run_path(str(DOCS / "examples" / f"{name}.py"))


def test_a_reader_of_your_own_gives_poses(tmp_path: Path) -> None:
    poses: list[Pose] = []
    source = PoseSource(tmp_path / "pose.sock", 0.0, poses.append)
    try:
        _example("pose_reader")["main"](str(tmp_path / "pose.sock"), 5)
        source.drain()
    finally:
        source.close()
    assert len(poses) == 5
    assert poses[0].p_enu_m == pytest.approx((1.0, 0.0, 1.5), abs=0.05)
    assert poses[0].v_enu_m_s == pytest.approx((0.0, 0.5, 0.0), abs=0.05)


def test_a_card_of_your_own_gives_records(tmp_path: Path) -> None:
    source = UnixSource(tmp_path / "csi.sock")
    try:
        _example("card")["main"](str(tmp_path / "csi.sock"))
        parsed = [parse_body(code, body) for code, body in source.drain()]
    finally:
        source.close()
    records = [record for record in parsed if isinstance(record, CsiRecord)]
    assert [record.frame_count for record in records] == list(range(10))
    assert records[3].timestamp_low_us == 30_000
    assert np.abs(records[0].csi).max() == pytest.approx(60, abs=1)


@pytest.mark.parametrize("azimuth_deg", [-120.0, 20.0, 75.0])
def test_an_estimator_of_your_own_finds_a_source(azimuth_deg: float) -> None:
    rng = np.random.default_rng(1)
    t_s = np.linspace(0.0, 3.0, 300)
    chi_m = np.stack([0.3 * t_s, 0.12 * np.cos(5 * t_s), 0.12 * np.sin(5 * t_s)], axis=1)
    chi_m -= chi_m.mean(axis=0)
    source = direction(math.radians(azimuth_deg), math.radians(80.0))
    loud = rng.uniform(0.1, 5.0, len(t_s))
    phase_rad = 4 * math.pi / WAVELENGTH_M * (chi_m @ source) + 0.2 * rng.normal(size=len(t_s))
    channel = np.asarray(loud * np.exp(1j * phase_rad), np.complex128)
    aperture = Aperture(
        t_s=t_s,
        chi_m=chi_m,
        channel=channel,
        wavelength_m=WAVELENGTH_M,
        reference_p_m=(0.0, 0.0, 1.5),
        reference_t_s=1.5,
    )
    estimate, profile = _example("estimator")["PhaseOnly"]().estimate(aperture)
    found = direction(estimate.azimuth_rad, estimate.polar_rad)
    assert math.degrees(float(great_circle(found, source))) < 1.5
    assert estimate.reliability > 0.5 and profile.power.max() > 0.8
