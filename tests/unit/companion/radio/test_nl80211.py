"""What an interface is set to, from the attributes in which the kernel says so."""

from __future__ import annotations

import errno
from dataclasses import replace

import pytest

from companion.config.file import load_config
from companion.radio.checks import tuned_checks
from companion.radio.nl80211 import Tuned, of_attributes, tuned
from csi_bridge.generic_netlink import attribute, attributes
from tests.paths import CONFIGS

CSI = replace(load_config(CONFIGS / "uav.yaml").csi, source="nl80211", width_mhz=80)


def _answer(**numbers: int) -> dict[int, memoryview]:
    kinds = {"frequency": 38, "width": 159, "centre": 160}
    told = b"".join(attribute(kinds[name], number.to_bytes(4, "little")) for name, number in numbers.items())
    return dict(attributes(memoryview(told)))


@pytest.mark.parametrize(
    ("answer", "found"),
    [
        (_answer(), None),
        (_answer(frequency=5540, width=1), Tuned(5540, 20)),
        (_answer(frequency=5540, width=3, centre=5530), Tuned(5540, 80)),
        (_answer(frequency=5540, width=5, centre=5570), Tuned(5540, 160)),
        (_answer(frequency=5540, width=13), Tuned(5540, None)),
        (_answer(frequency=5540), Tuned(5540, None)),
    ],
)
def test_frequency_and_width_are_read(answer: dict[int, memoryview], found: Tuned | None) -> None:
    assert of_attributes(answer) == found


def test_an_interface_that_is_not_there_or_not_wireless_is_an_os_error() -> None:
    with pytest.raises(OSError):
        tuned("nosuch0")
    with pytest.raises(OSError) as refused:
        tuned("lo")
    assert refused.value.errno in (errno.ENODEV, errno.ENOENT, errno.EPERM, errno.EPROTONOSUPPORT)


def test_a_channel_that_is_too_narrow_is_told_with_what_to_do() -> None:
    checks = {check.name: check for check in tuned_checks(CSI, 5540, Tuned(5540, 20), "iw ..")}
    assert checks["channel"].ok
    assert (checks["channel width"].ok, checks["channel width"].remedy) == (False, "iw ..")
    assert checks["channel width"].found == "20 MHz, csi.width_mhz is 80"
    assert [check.ok for check in tuned_checks(CSI, 5540, Tuned(5500, 80), "iw ..")] == [False, True]
    assert [check.ok for check in tuned_checks(CSI, 5540, None, "iw ..")] == [False]
    assert [check.ok for check in tuned_checks(CSI, 5540, Tuned(5540, None), "iw ..")] == [True, None]
