"""The beacon sends the channel of its strongest antenna, and changes it seldom."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from companion.radio.card import ChannelSample
from companion.roles.beacon import Beacon


class _Sender:
    """Keeps what is queued."""

    def __init__(self) -> None:
        self.antennas: list[int] = []
        self.channels: list[np.ndarray] = []
        self.frames: list[int | None] = []
        self.ticks: list[int] = []

    def add_channel(
        self, frame: int | None, t_ns: int, nic_us: int, csi: np.ndarray, *, power_dbm: float, antenna: int, **more: Any
    ) -> None:
        self.frames.append(frame)
        self.channels.append(csi)
        self.antennas.append(antenna)
        self.ticks.append(more["ticks"])


def _sample(*amplitudes: float, **changes: Any) -> ChannelSample:
    csi = np.ones((30, len(amplitudes))) * np.array(amplitudes)
    values: dict[str, Any] = {
        "peer": 1, "frame": 7, "t_mono_ns": 5, "nic_us": 9, "channel": csi.astype(np.complex64), "power_dbm": -50.0,
    }  # fmt: skip
    return ChannelSample(**values | changes)


@pytest.fixture
def both() -> tuple[Beacon, _Sender]:
    sender = _Sender()
    return Beacon(sender), sender  # type: ignore[arg-type]


def test_the_first_packet_chooses_the_strongest(both: tuple[Beacon, _Sender]) -> None:
    beacon, sender = both
    beacon.add_sample(_sample(1.0, 9.0, 3.0))
    assert (sender.antennas, sender.frames) == ([1], [7])
    assert sender.channels[0].tolist() == [9.0] * 30


def test_one_fade_changes_nothing_and_a_lasting_change_does(both: tuple[Beacon, _Sender]) -> None:
    beacon, sender = both
    for _ in range(50):
        beacon.add_sample(_sample(1.0, 9.0, 3.0))
    beacon.add_sample(_sample(9.0, 0.1, 3.0))
    assert set(sender.antennas) == {1}
    for _ in range(300):
        beacon.add_sample(_sample(9.0, 1.0, 3.0))
    assert sender.antennas[-1] == 0
    changes = sum(a != b for a, b in zip(sender.antennas, sender.antennas[1:], strict=False))
    assert changes == 1


def test_another_must_have_twice_the_power(both: tuple[Beacon, _Sender]) -> None:
    beacon, sender = both
    beacon.add_sample(_sample(1.0, 3.0))
    for _ in range(500):
        beacon.add_sample(_sample(4.0, 3.0))
    assert set(sender.antennas) == {1}, "sixteen against nine is no reason to split an aperture"


def test_an_ax_cards_fine_clock_goes_along(both: tuple[Beacon, _Sender]) -> None:
    beacon, sender = both
    beacon.add_sample(_sample(1.0, fine_us=10.0))
    beacon.add_sample(_sample(1.0, frame=None))
    assert sender.ticks == [3200, 0]
    assert sender.frames == [7, None]
