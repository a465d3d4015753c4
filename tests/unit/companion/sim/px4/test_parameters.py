"""PX4's way of carrying parameters over MAVLink."""

from __future__ import annotations

import struct

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.px4.parameters import DEFAULTS, field_and_kind, parsed, written
from tests.unit.companion.sim.px4.client import Client

_INT32, _REAL32 = mavlink.MAV_PARAM_TYPE_INT32, mavlink.MAV_PARAM_TYPE_REAL32


@pytest.mark.parametrize("value", [0, 1, -1, 5, 1 << 30])
def test_an_integer_stands_in_the_bytes_of_the_float(value: int) -> None:
    field, kind = field_and_kind(value)
    assert kind == _INT32
    assert struct.pack("<f", field) == struct.pack("<i", value)
    back = written(0, field, kind)
    assert (back, type(back)) == (value, int)


def test_a_float_is_itself_and_no_parameter_takes_the_other_type() -> None:
    assert field_and_kind(2.5) == (2.5, _REAL32)
    assert written(1.0, 2.5, _REAL32) == 2.5
    assert written(1.0, 2.5, _INT32) is None
    assert written(1, 2.0, _REAL32) is None


def test_text_becomes_what_the_parameter_is() -> None:
    for name, text, value in (("COM_OBL_RC_ACT", "5", 5), ("COM_OF_LOSS_T", "5", 5.0)):
        found = parsed(name, text)
        assert (found, type(found)) == (value, type(DEFAULTS[name]))
    with pytest.raises(ValueError, match=r"1\.5"):
        parsed("COM_OBL_RC_ACT", "1.5")
    with pytest.raises(KeyError):
        parsed("NO_SUCH", "1")


@pytest.fixture
def client() -> Client:
    return Client(parameters={"COM_OBL_RC_ACT": 5, "MIS_TAKEOFF_ALT": 1.5})


def test_parameters_carry_integers_byte_by_byte(client: Client) -> None:
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OBL_RC_ACT", -1))
    value = client.messages("PARAM_VALUE")[-1]
    assert value.param_type == mavlink.MAV_PARAM_TYPE_INT32
    assert struct.unpack("<i", struct.pack("<f", value.param_value))[0] == 5
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"MIS_TAKEOFF_ALT", 2.0, mavlink.MAV_PARAM_TYPE_REAL32))
    assert client.messages("PARAM_VALUE")[-1].param_value == 2.0
    four = struct.unpack("<f", struct.pack("<i", 4))[0]
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", four, mavlink.MAV_PARAM_TYPE_INT32))
    assert client.px4.commander.parameters["COM_OBL_RC_ACT"] == 4
    before = len(client.messages("PARAM_VALUE"))
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"NO_SUCH", 1.0, mavlink.MAV_PARAM_TYPE_REAL32))
    assert len(client.messages("PARAM_VALUE")) == before
    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    assert len(client.messages("PARAM_VALUE")) == before + len(client.px4.commander.parameters)
