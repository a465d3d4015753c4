"""Amplitudes of a log of CSI over packets and subcarriers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from companion.analysis.csi_logs import Amplitudes
from companion.pictures.csi import draw_amplitudes


def _amplitudes(packets: int) -> Amplitudes:
    hz = 312_500.0 * np.arange(-28.0, 29.0, 2.0)
    return Amplitudes(
        "B", 0.01 * np.arange(packets, dtype=np.float64), hz, np.full((packets, hz.size), 10.0, np.float32)
    )


def test_one_row_a_packet_whose_axis_says_when_it_came(tmp_path: Path, shown: list[Figure]) -> None:
    draw_amplitudes(tmp_path / "a.png", "log.dat: 5300", _amplitudes(200))
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    axes, bar = shown[0].axes
    (mesh,) = axes.collections
    values = np.asarray(mesh.get_array())
    assert values.shape == (200, 29)
    assert np.all(values == 20.0), "dB of what the card counts"
    assert axes.get_title() == "log.dat: 5300"
    assert axes.get_yticklabels()[-1].get_text() == "1.99"
    assert "antenna B" in bar.get_ylabel()


def test_of_a_long_log_some_rows_stand_for_all(tmp_path: Path, shown: list[Figure]) -> None:
    draw_amplitudes(tmp_path / "a.png", "long", _amplitudes(4000))
    assert np.asarray(shown[0].axes[0].collections[0].get_array()).shape[0] == 1500
