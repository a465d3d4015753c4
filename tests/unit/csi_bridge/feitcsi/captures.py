"""The eight public captures, by name."""

from __future__ import annotations

from typing import Final

import pytest

from csi_bridge.feitcsi.log import FeitLog
from csi_bridge.feitcsi.rate import Format
from tests.feit_records import CAPTURES, needs_captures, read_log

EXPECTED: Final = {
    "HESU160_5500": (26, Format.HE, 160, 1992),
    "HESU20_5500": (28, Format.HE, 20, 242),
    "HESU80_5500": (28, Format.HE, 80, 996),
    "HT20_2452": (48, Format.HT, 20, 56),
    "HT40_2452": (34, Format.HT, 40, 114),
    "VHT160_5500": (35, Format.VHT, 160, 484),
    "VHT20_5500": (28, Format.VHT, 20, 56),
    "VHT80_5500": (40, Format.VHT, 80, 242),
}
EACH: Final = [needs_captures, pytest.mark.parametrize("name", sorted(EXPECTED))]


def capture(name: str) -> FeitLog:
    return read_log(CAPTURES / f"{name}.csi")
