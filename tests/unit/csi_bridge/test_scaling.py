"""Absolute units and spatial mapping, against csiread on real layout-20 captures."""

from __future__ import annotations

import numpy as np
import pytest

from csi_bridge.dat import read_dat
from csi_bridge.records import CsiRecord
from csi_bridge.scaling import (
    subcarrier_hz,
    total_rss_dbm,
    without_spatial_mapping,
)
from tests.csi_records import needs_data, parsed, read_with_csiread
from tests.paths import DATA

SAMPLES = DATA / "csi_samples"


def records(name: str, count: int = 40) -> list[CsiRecord]:
    found = [one for _, one in parsed((SAMPLES / name).read_bytes()) if isinstance(one, CsiRecord)]
    return found[:count]


@needs_data
@pytest.mark.parametrize("name", ["sample_0x1_ap.dat", "sample_0x5_64_3000.dat"])
def test_total_power_is_that_of_csiread(name: str) -> None:
    oracle = read_with_csiread(SAMPLES / name, 3, 2)
    for record, theirs in zip(records(name), oracle.get_total_rss(), strict=False):
        assert total_rss_dbm(record.rssi, record.agc) == pytest.approx(theirs, abs=0.1)  # it uses a table of powers


@needs_data
def test_spatial_mapping_is_that_of_csiread_at_all_its_rates() -> None:
    """It scales each packet first, which the mapping does not feel."""
    name = "sample_0x1_ap.dat"
    oracle = read_with_csiread(SAMPLES / name, 3, 2)
    theirs = oracle.get_scaled_csi_sm()
    seen = set()
    for number, record in enumerate(records(name, 540)):
        ours = without_spatial_mapping(record.csi, record.rate)
        expected = theirs[number, :, :3, : record.n_tx]
        scale = np.linalg.norm(expected) / np.linalg.norm(ours)
        np.testing.assert_allclose(scale * ours, expected, rtol=2e-3, atol=2e-2)
        seen.add((record.n_tx, record.rate))
    assert len(seen) > 2


@pytest.mark.parametrize("rate", [0x100, 0x100 | 0x800])
@pytest.mark.parametrize("n_tx", [2, 3])
def test_what_the_sender_mixed_is_taken_apart(rate: int, n_tx: int) -> None:
    rng = np.random.default_rng(n_tx)
    channel = (rng.normal(size=(30, 3, n_tx)) + 1j * rng.normal(size=(30, 3, n_tx))).astype(np.complex64)
    unit = without_spatial_mapping(np.eye(n_tx, dtype=np.complex64)[np.newaxis], rate)[0]
    assert np.abs(unit @ unit.conj().T - np.eye(n_tx)).max() < 1e-6  # it loses nothing
    mixed = channel @ unit.conj().T
    np.testing.assert_allclose(without_spatial_mapping(mixed, rate), channel, atol=1e-5)
    assert without_spatial_mapping(channel, 0x4) is channel  # not an HT rate
    assert without_spatial_mapping(channel[..., :1], rate).shape == (30, 3, 1)


def test_subcarriers_of_both_bandwidths() -> None:
    narrow, wide = subcarrier_hz(0x101) / 312_500, subcarrier_hz(0x101 | 0x800) / 312_500
    assert narrow.tolist() == [*range(-28, 0, 2), -1, *range(1, 28, 2), 28]
    assert (wide[0], wide[-1]) == (-58, 58)
    assert np.unique(np.diff(wide)).tolist() == [4]
    assert len(wide) == len(narrow) == 30


@needs_data
def test_power_of_a_real_record_is_one_that_a_card_can_hear() -> None:
    log = read_dat(SAMPLES / "sample_0x5_64_3000.dat")
    assert -100 < total_rss_dbm((int(log.rssi[0, 0]), int(log.rssi[0, 1]), int(log.rssi[0, 2])), int(log.agc[0])) < 0


def test_an_empty_report_stays_empty() -> None:
    assert total_rss_dbm((0, 0, 0), 30) == -np.inf
