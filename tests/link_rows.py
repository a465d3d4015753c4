"""Rows of an evaluation, made by hand."""

from __future__ import annotations

from companion.analysis.evaluation import LinkRow


def row(set_name: str, error_deg: float, reliability: float = 0.9, reason: str = "") -> LinkRow:
    return LinkRow(
        set=set_name,
        position="L1",
        run="run",
        tx="tx2",
        error_deg=error_deg,
        azimuth_deg=0.0,
        true_azimuth_deg=0.0,
        polar_deg=None,
        true_polar_deg=None,
        elevation_deg=None,
        true_elevation_deg=None,
        azimuth_std_deg=1.0,
        reliability=reliability,
        packets=500,
        reason=reason,
    )
