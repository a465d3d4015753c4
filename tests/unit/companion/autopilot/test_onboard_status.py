"""What this computer tells the ground station of itself."""

from __future__ import annotations

import os
import time

from pymavlink.dialects.v20.common import MAVLink_onboard_computer_status_message as Message

from companion.autopilot.onboard_status import fields


def test_every_field_of_the_message_is_there_in_its_size_and_range() -> None:
    told = fields()
    assert told.keys() <= set(Message.fieldnames)  # a newer definition may have more behind them
    sizes = dict(zip(Message.ordered_fieldnames, Message.array_lengths, strict=True))
    for name, value in told.items():
        assert len(value) == sizes[name] if isinstance(value, list) else sizes[name] == 0, name
    Message(**told).pack(_Link())


def test_values_are_those_of_this_machine() -> None:
    told = fields()
    assert abs(told["time_usec"] / 1e6 - time.time()) < 60
    assert 0 <= told["cpu_combined"][0] <= 100
    assert 0 < told["ram_usage"] < told["ram_total"]
    assert told["ram_total"] == os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // (1 << 20)
    assert 0 < told["storage_usage"][0] <= told["storage_total"][0]


def test_what_is_not_known_is_sent_as_the_definition_has_it() -> None:
    told = fields()
    assert told["temperature_board"] == 127
    assert told["gpu_cores"] == [255] * 4
    assert told["fan_speed"] == [32767] * 4
    assert told["link_tx_rate"] == [4294967295] * 6


class _Link:
    """As much of pymavlink's connection as packing asks for."""

    srcSystem = srcComponent = seq = 1
    signing = type("signing", (), {"sign_outgoing": False})
