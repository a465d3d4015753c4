"""Channels of the public captures: pilots, the gap at the centre, and what is thinned."""

from __future__ import annotations

import numpy as np

from csi_bridge.feitcsi.channel import channel, thinned
from tests.unit.csi_bridge.feitcsi.captures import EACH, capture

pytestmark = EACH


def test_pilots_hold_nothing_and_are_filled_in(name: str) -> None:
    for record in capture(name).records:
        plan = record.tones
        pilots = ~plan.valid if plan.index[-1] * plan.spacing_hz < 60e6 else ~plan.valid & (record.csi[:, 0, 0] == 0)
        assert not record.csi[pilots].any()
        filled = np.abs(channel(record))
        assert filled.min() > 0.1 * np.median(filled)


def test_phases_go_on_evenly_over_the_gap_at_the_centre_and_where_the_sender_turned(name: str) -> None:
    log = capture(name)
    plan = log.records[0].tones
    h = np.array([channel(record)[:, 0, 0] for record in log.records])
    step = np.diff(plan.index)
    products = h[:, 1:] * h[:, :-1].conj()
    slope = np.angle(products[:, step == 1].sum())
    assert slope < 0, "a delay lets phases fall with the frequency"
    off = np.angle(products.mean(axis=0) * np.exp(-1j * slope * step))
    assert np.abs(off).max() < 0.3


def test_thinned_channels_are_625_khz_apart_and_follow_the_whole_one(name: str) -> None:
    record = capture(name).records[0]
    thin, hz = thinned(record)
    assert thin.shape == (len(hz), 2, 1)
    gaps = np.diff(hz)
    assert np.isclose(gaps, 625e3).mean() > 0.95 and gaps.min() > 624e3
    whole = channel(record)[:, 1, 0]
    between = np.interp(hz, record.subcarrier_hz, whole.real) + 1j * np.interp(hz, record.subcarrier_hz, whole.imag)
    assert np.abs(thin[:, 1, 0] - between).max() < 0.15 * np.abs(whole).max()
