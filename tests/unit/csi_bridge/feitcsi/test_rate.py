"""The rate word, bit by bit."""

from __future__ import annotations

import pytest

from csi_bridge.feitcsi.rate import Format, Rate


@pytest.mark.parametrize(
    ("word", "index", "kind", "width_mhz", "antennas", "text"),
    [
        (0x0000, 0, Format.CCK, 20, (), "CCK 20 MHz"),
        (0x4101, 1, Format.OFDM, 20, (0,), "OFDM 20 MHz"),
        (0x8A07, 7, Format.HT, 40, (1,), "HT 40 MHz"),
        (0xD309, 9, Format.VHT, 80, (0, 1), "VHT 80 MHz"),
        (0x1DC0B, 11, Format.HE, 160, (0, 1), "HE 160 MHz"),
        (0xE500, 0, Format.EHT, 320, (0, 1), "EHT 320 MHz"),
        (0x0700, 0, None, 20, (), "unknown format 20 MHz"),
        (0x2C00, 0, Format.HE, None, (), "HE"),
    ],
)
def test_fields_of_a_word(
    word: int, index: int, kind: Format | None, width_mhz: int | None, antennas: tuple[int, ...], text: str
) -> None:
    rate = Rate(word)
    assert (rate.index, rate.format, rate.width_mhz, rate.antennas) == (index, kind, width_mhz, antennas)
    assert str(rate) == text


def test_the_layout_is_format_and_width_and_nothing_else() -> None:
    assert Rate(0x1DC0B).layout == Format.HE | 3 << 3
    assert Rate(0x0C00).layout == Rate(0x1DC0B & ~0x1000F).layout - (2 << 3)
    assert Rate(0xFFFF_C0FF).layout == 0
