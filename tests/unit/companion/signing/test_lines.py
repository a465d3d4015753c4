"""The serial end of the relay on a pseudo-terminal: nothing grows old in it."""

from __future__ import annotations

import os
import pty
import time
from pathlib import Path

from companion.signing.lines import OLDEST_S, SerialLine
from tests.signed_link import setpoint


def test_noise_that_looks_like_a_long_frame_does_not_hold_others_until_they_are_old() -> None:
    vehicle, device = pty.openpty()
    line = SerialLine(Path(os.ttyname(device)), 921600)
    os.write(vehicle, b"\xfd\xff\x00" + setpoint(1))
    assert line.receive() == []
    time.sleep(OLDEST_S + 0.05)
    os.write(vehicle, setpoint(2))
    assert line.receive() == [(setpoint(2), 0.0)], "the first is old by now"
    os.write(vehicle, setpoint(3)[:9])
    assert line.receive() == []
    os.write(vehicle, setpoint(3)[9:])
    assert line.receive() == [(setpoint(3), 0.0)]
    line.close()
    os.close(vehicle)
    os.close(device)
