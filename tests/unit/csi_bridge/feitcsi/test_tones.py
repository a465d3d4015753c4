"""Where the subcarriers of each format lie: the standard's numbers of data and pilot tones."""

from __future__ import annotations

import numpy as np
import pytest

from csi_bridge.feitcsi.rate import Format
from csi_bridge.feitcsi.tones import SUBCARRIERS, tones, tones_of
from tests.feit_records import rate_word


@pytest.mark.parametrize(
    ("kind", "width_mhz", "all_tones", "pilots", "spacing_hz"),
    [
        (Format.OFDM, 20, 52, 4, 312_500.0),
        (Format.HT, 20, 56, 4, 312_500.0),
        (Format.VHT, 20, 56, 4, 312_500.0),
        (Format.HT, 40, 114, 6, 312_500.0),
        (Format.VHT, 40, 114, 6, 312_500.0),
        (Format.VHT, 80, 242, 8, 312_500.0),
        (Format.HE, 20, 242, 8, 78_125.0),
        (Format.HE, 40, 484, 16, 78_125.0),
        (Format.HE, 80, 996, 16, 78_125.0),
    ],
)
def test_numbers_of_tones_are_the_standards(
    kind: Format, width_mhz: int, all_tones: int, pilots: int, spacing_hz: float
) -> None:
    plan = tones(kind, width_mhz)
    assert plan is not None
    assert plan.index.size == plan.valid.size == plan.turn.size == all_tones
    assert all_tones - int(plan.valid.sum()) == pilots
    assert plan.spacing_hz == spacing_hz
    np.testing.assert_array_equal(plan.index, -plan.index[::-1])
    assert np.all(np.diff(plan.index) > 0)
    assert plan.frequency_hz[-1] < width_mhz * 1e6 / 2
    assert plan is tones_of(rate_word(kind, width_mhz)) or kind == Format.VHT


@pytest.mark.parametrize(("kind", "pilots"), [(Format.VHT, 16), (Format.HE, 32)])
def test_the_hollows_of_160_mhz_hold_nothing(kind: Format, pilots: int) -> None:
    plan = tones(kind, 160)
    assert plan is not None
    hollow = np.abs(np.abs(plan.frequency_hz) - 60e6) <= 2 * plan.spacing_hz
    assert not plan.valid[hollow].any()
    assert np.count_nonzero(~plan.valid & ~hollow) <= pilots


@pytest.mark.parametrize(("kind", "width_mhz"), [(Format.CCK, 20), (Format.EHT, 320), (Format.OFDM, 40)])
def test_a_format_without_a_plan_has_none(kind: Format, width_mhz: int) -> None:
    assert tones(kind, width_mhz) is None
    assert tones_of(0x7 << 8) is None
    assert tones_of(Format.HE << 8 | 7 << 11) is None


def test_what_the_sender_turned_is_that_of_the_standard() -> None:
    """Table 21-26 and 19.3.9.3.4: the upper half of 40 MHz by j, all but the lowest 20 MHz of 80 by -1; HE nothing."""
    forty, eighty, he = tones(Format.HT, 40), tones(Format.VHT, 80), tones(Format.HE, 80)
    assert forty is not None
    assert eighty is not None
    assert he is not None
    np.testing.assert_array_equal(forty.turn, np.where(forty.index > 0, 1j, 1))
    np.testing.assert_array_equal(eighty.turn, np.where(eighty.index >= -64, -1, 1))
    assert np.all(he.turn == 1)


def test_every_number_of_subcarriers_is_listed() -> None:
    assert SUBCARRIERS == (52, 56, 114, 242, 484, 996, 1992)
