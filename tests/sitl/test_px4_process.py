"""The mock autopilot as a process: its options, its truth datagrams and its end."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest

from companion.host.unix_datagram import bind_datagram_socket
from companion.sim import truth
from companion.sim.stage import free_udp_port
from tests.sitl.px4_process import Px4Process


def test_truth_is_sent_at_100_hz_and_a_missing_receiver_does_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "truth.sock"
    with Px4Process(free_udp_port("127.0.0.1"), tmp_path, "--truth", str(path), "--yaw", "0.5") as px4:
        time.sleep(0.2)
        for _ in range(2):  # the receiver goes and comes back
            with bind_datagram_socket(path) as receiver:
                receiver.settimeout(2)
                states = [truth.decode_vehicle(receiver.recv(4096)) for _ in range(51)]
            spacings_s = [(b.t_mono_ns - a.t_mono_ns) / 1e9 for a, b in pairwise(states)]
            assert statistics.median(spacings_s) == pytest.approx(0.01, abs=0.005)  # a busy machine makes some longer
            assert states[0].yaw_enu_rad == 0.5 and states[0].mode == "HOLD" and not states[0].armed
            path.unlink()
        assert px4.report().setpoints == 0


def test_an_order_it_does_not_know_is_an_error(tmp_path: Path) -> None:
    with Px4Process(free_udp_port("127.0.0.1"), tmp_path) as px4, pytest.raises(ValueError, match="order 'dance'"):
        px4.order("dance")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--connect", "14540"], "expected HOST:PORT"),
        (["--connect", "127.0.0.1:1", "--param", "NO_SUCH=1"], "expected NAME=VALUE"),
        ([], "--connect"),
    ],
)
def test_bad_options_are_usage_errors(options: list[str], said: str) -> None:
    command = [sys.executable, "-m", "companion.sim.px4.autopilot", *options]
    result = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    assert result.returncode == 2 and said in result.stderr
