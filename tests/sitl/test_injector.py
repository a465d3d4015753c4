"""Pings byte for byte on a real interface pair in a network namespace of its own, read back by scapy."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

NAMESPACE = ("unshare", "--net", "--mount", "sh", "-c", 'mount -t sysfs sysfs /sys && eval "$0"')
"""Its own network, and a /sys that shows it."""
SCRIPT = Path(__file__).with_name("injector_peer.py")


def _namespace_refused() -> str:
    done = subprocess.run(
        [*NAMESPACE, "ip link add left type veth peer name right"],
        capture_output=True,
        text=True,
    )
    return "" if done.returncode == 0 else f"no network namespace with a veth pair: {done.stderr.strip()}"


REFUSED = _namespace_refused()
needs_namespace = pytest.mark.skipif(bool(REFUSED), reason=REFUSED or "-")


def inside(*arguments: str) -> str:
    """What `injector_peer.py` prints, run in a new namespace."""
    done = subprocess.run(
        [*NAMESPACE, shlex.join([sys.executable, str(SCRIPT), *arguments])], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@needs_namespace
def test_scapy_reads_every_field_of_a_ping_on_the_wire_and_makes_the_same_bytes() -> None:
    lines = inside("fields").splitlines()
    assert lines == [
        "type 2 subtype 0 tods 0 duration 65535 sequence 0",
        "addresses 00:16:ea:12:34:56 00:16:ea:12:34:56 00:21:6a:53:89:d2",
        "counter 01020304 at 24 big-endian",
        "radiotap txflags 8 mcs 3 bandwidth 0 guard 0",
        "frame 53 bytes, 57 with check sum",
        "scapy makes the same bytes",
    ]


@needs_namespace
def test_a_beacon_answers_from_user_space_with_the_same_counters() -> None:
    words = inside("echo").split()
    assert words[:4] == ["answers", "50", "of", "50"]
    turnaround_ms = float(words[5])
    assert 0 < turnaround_ms < 500  # the figure is the point; machines are noisy


@needs_namespace
def test_scapy_reads_every_field_of_an_ax_cards_ping_on_the_wire() -> None:
    assert inside("vht").splitlines() == [
        "addresses 00:16:ea:12:34:56 00:21:6a:53:89:d2 00:21:6a:3f:17:5a",
        "radiotap txflags 8 known 0x44 bandwidth 4",
        "mcs and streams 31000000 of 24 bytes",
    ]


@needs_namespace
def test_ends_without_counters_answer_by_address_and_are_paired_by_their_times() -> None:
    words = inside("exchange", "5").split()
    pings, answered, others, paired, wrong = map(int, words[1:10:2])
    assert words[:10:2] == ["pings", "answered", "others", "paired", "wrong"]
    assert answered == pings > 200 and others == 0
    # An answer that the machine holds up finds no partner; what is paired belongs together.
    assert paired > 0.7 * pings
    assert wrong <= 0.01 * paired


@needs_namespace
def test_default_pings_stay_under_ten_kilobytes_a_second_at_the_interface() -> None:
    words = inside("rate").split()
    assert words[0] == "bytes_per_s"
    assert 0 < float(words[1]) < 10_000


@needs_namespace
def test_datagrams_of_150_packets_and_50_poses_stay_under_five_kilobytes_a_second_at_the_interface() -> None:
    words = inside("datagrams").split()
    assert words[::2] == ["bytes", "counted", "thinned"]
    at_interface, counted, thinned = map(int, words[1::2])
    assert thinned == 0
    assert 3000 < counted < 5000
    # The kernel's count has what the network stack says of itself in it.
    assert counted <= at_interface < 5000


@needs_namespace
def test_broadcast_and_multicast_use_the_interface_that_is_named() -> None:
    *heard, routeless, elsewhere, missing = inside("addresses").splitlines()
    assert heard == ["heard 1 left True"] * 3
    assert routeless.startswith("refused neighbours.broadcast 239.1.2.3, port 17650: No such device; expected")
    assert elsewhere.startswith("refused neighbours.broadcast 10.99.0.255")
    assert missing == "refused neighbours.interface nosuch: there is no such interface"
