"""Runs in a network namespace of its own: makes an interface pair and does what its argument says."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import socket
import statistics
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from companion.analysis.by_time import pair_by_card_time
from companion.config.schema import Config, CsiConfig, NeighbourConfig, Peer, PingConfig
from companion.core.clock import MonotonicClock
from companion.errors import CompanionError
from companion.neighbours import wire
from companion.neighbours.link import Link
from companion.neighbours.sender import NeighbourSender
from companion.radio.pinger import Pinger
from companion.radio.traffic import sent_bytes
from csi_bridge.injector import Injector, parse_capture, ping_frame, radiotap, vht_radiotap

TAP = len(radiotap(1))
_SO_TIMESTAMPNS = 35
MAC, OTHER = bytes.fromhex("00216a5389d2"), bytes.fromhex("00216a3f175a")
CONFIG = Config(
    role="uav",
    id=1,
    name="uav",
    csi=CsiConfig(108, interface="left"),
    neighbours=NeighbourConfig(key_file="key"),
    peers=[Peer(2, "beacon", "00:21:6A:3F:17:5A", "key")],
    ping=PingConfig(enabled=True),
)


def make_pair() -> None:
    for words in ("link add left type veth peer name right", "link set left up", "link set right up"):
        subprocess.run(["ip", *words.split()], check=True)
    while Path("/sys/class/net/left/carrier").read_text().strip() != "1":
        time.sleep(0.01)


def fields() -> None:
    from scapy.layers.dot11 import Dot11, RadioTap
    from scapy.packet import Raw

    sender, listener = Injector("left", 3), Injector("right", 1)
    sender.send(ping_frame(MAC, 0x01020304, 57))
    data = next(data for data in received(listener) if data[24 + TAP : 28 + TAP] == bytes([1, 2, 3, 4]))
    tap = RadioTap(data)
    frame = tap[Dot11]
    print(
        f"type {frame.type} subtype {frame.subtype} tods {int(frame.FCfield)} duration {frame.ID} sequence {frame.SC}"
    )
    print("addresses", frame.addr1, frame.addr2, frame.addr3)
    raw = data[tap.len :]
    print("counter", raw[24:28].hex(), "at 24 big-endian")
    flags = int(tap.TXFlags)
    print(f"radiotap txflags {flags} mcs {tap.MCS_index} bandwidth {tap.MCS_bandwidth} guard {tap.guard_interval}")
    print(f"frame {len(raw)} bytes, {len(raw) + 4} with check sum")
    card = "00:16:ea:12:34:56"
    built = (
        RadioTap(present="Flags+TXFlags+MCS", Flags=0, TXFlags="NOACK", knownMCS=7, MCS_index=3)
        / Dot11(type=2, subtype=0, ID=0xFFFF, addr1=card, addr2=card, addr3="00:21:6a:53:89:d2", SC=0)
        / Raw(bytes([1, 2, 3, 4]) + bytes(range(4, 4 + 25)))
    )
    print("scapy makes the same bytes" if bytes(built) == data else f"scapy makes {bytes(built).hex()}")


def received(listener: Injector, tap: int = TAP) -> list[bytes]:
    raw = socket.socket(fileno=socket.dup(listener.fileno()))
    raw.settimeout(2.0)
    found = []
    with raw, contextlib.suppress(TimeoutError, BlockingIOError):
        deadline_s = time.monotonic() + 2.0
        while time.monotonic() < deadline_s:
            found.append(raw.recv(4096))
            if found[-1][4 + tap : 10 + tap] == bytes.fromhex("0016ea123456"):
                break
    return found


async def echo() -> None:
    beacon = dataclasses.replace(CONFIG, role="beacon", id=2, csi=CsiConfig(108, interface="right"))
    answering = Pinger(beacon, Injector("right", 1), MonotonicClock(), OTHER)
    ours = Injector("left", 1)
    asyncio.get_running_loop().add_reader(answering.fileno(), answering.drain)
    answers, times = 0, []
    for counter in range(1, 51):
        start_s = time.monotonic()
        ours.send(ping_frame(MAC, counter, 57))
        while time.monotonic() - start_s < 1.0:
            await asyncio.sleep(0)
            heard = [ping for ping in ours.captured() if ping.mac == OTHER]
            if heard:
                assert heard[0].counter == counter
                assert heard[0].length == 54
                answers += len(heard)
                times.append(1e3 * (time.monotonic() - start_s))
                break
    print(f"answers {answers} of 50 median_ms {statistics.median(times):.3f}")


def vht() -> None:
    from scapy.layers.dot11 import Dot11, RadioTap

    sender, listener = Injector("left", 3, 80), Injector("right", 1)
    sender.send(ping_frame(MAC, 7, 57, OTHER))
    tap = RadioTap(received(listener, len(vht_radiotap(3, 80)))[-1])
    frame = tap[Dot11]
    print("addresses", frame.addr1, frame.addr2, frame.addr3)
    print(f"radiotap txflags {int(tap.TXFlags)} known {int(tap.KnownVHT):#x} bandwidth {tap.VHT_bandwidth}")
    print(f"mcs and streams {bytes(tap)[16:20].hex()} of {tap.len} bytes")


async def exchange() -> None:
    """Both ends of AX cards for some seconds: who answers whom by the addresses alone, and which packets belong
    together by the times alone, against the counters that such a card does not report."""
    seconds = float(sys.argv[2])
    uav = dataclasses.replace(CONFIG, csi=CsiConfig(108, "nl80211", interface="left", width_mhz=80))
    beacon = dataclasses.replace(uav, role="beacon", id=2)
    clock = MonotonicClock()
    pinging = Pinger(uav, Injector("left", 1, 80), clock, MAC)
    answering = Pinger(beacon, Injector("right", 1, 80), clock, OTHER)
    bystander = Pinger(dataclasses.replace(beacon, id=3), Injector("right", 1, 80), clock, bytes(6))
    loop = asyncio.get_running_loop()
    heard: dict[bytes, list[tuple[int, int]]] = {MAC: [], OTHER: []}
    taps = [_tap(end) for end in ("left", "right")]
    for tap in taps:
        loop.add_reader(tap.fileno(), _note, tap, heard)
    for pinger in (answering, bystander):
        loop.add_reader(pinger.fileno(), pinger.drain)
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            await pinging.run()
    await asyncio.sleep(0.2)
    ours, theirs = (np.array(heard[mac], np.float64) for mac in (OTHER, MAC))
    i, j = pair_by_card_time(ours[:, 0] / 1e3, theirs[:, 0] / 1e3 + 38e6)
    wrong = int(np.count_nonzero(ours[i, 1] != theirs[j, 1]))
    late_ms = 1e-6 * (ours[i, 0] - theirs[j, 0])
    print(
        f"pings {len(theirs)} answered {answering.answered} others {bystander.answered} paired {len(i)} wrong {wrong}"
    )
    print(f"turnaround_ms median {np.median(late_ms):.3f} deviation {np.std(late_ms):.3f}")


def _tap(interface: str) -> socket.socket:
    """Hears what comes in at an interface, with the kernel's time of it."""
    tap = socket.socket(socket.AF_PACKET, socket.SOCK_RAW | socket.SOCK_NONBLOCK, socket.htons(3))
    tap.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
    tap.bind((interface, 0))
    return tap


def _note(tap: socket.socket, heard: dict[bytes, list[tuple[int, int]]]) -> None:
    data, extra, _, address = tap.recvmsg(4096, 256)
    if address[2] != socket.PACKET_OUTGOING and (ping := parse_capture(data)) is not None:
        seconds, nanoseconds = struct.unpack("qq", extra[0][2])
        heard[ping.mac].append((seconds * 10**9 + nanoseconds, ping.counter))


async def rate() -> None:
    pinger = Pinger(CONFIG, Injector("left", 1), MonotonicClock(), MAC)
    before, start_s = sent_bytes("left"), time.monotonic()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(1.0):
            await pinger.run()
    after = sent_bytes("left")
    assert before is not None
    assert after is not None
    print(f"bytes_per_s {(after - before) / (time.monotonic() - start_s):.0f} pings {pinger.health()['sent']:.0f}")


def datagrams() -> None:
    """One second of 150 channels and 50 poses of a robot that moves, as the kernel counts them at the interface."""
    subprocess.run(["ip", "addr", "add", "10.9.0.1/24", "broadcast", "10.9.0.255", "dev", "left"], check=True)
    neighbours = NeighbourConfig(key_file="key", port=17650, broadcast="10.9.0.255", interface="left")
    link = Link(dataclasses.replace(CONFIG, neighbours=neighbours))
    sender = NeighbourSender(
        role=wire.Role.BEACON,
        own_id=2,
        key=bytes(32),
        pose_rate_hz=neighbours.pose_rate_hz,
        boot_id=1 << 32,
        budget_bytes_s=neighbours.budget_bytes_s,
    )
    rng = np.random.default_rng(5)
    sender.add_heard(1, 0, 0)
    before = sent_bytes("left")
    for step in range(1000):
        t_ns = step * 1_000_000
        if sender.wants_pose(t_ns):
            sender.add_pose(t_ns, (1e-3 * step, 5e-4 * step, 1e-4 * step), 3)
        if step * 150 // 1000 != (step + 1) * 150 // 1000:  # every coefficient of such a channel needs all its bits
            csi = (rng.normal(size=30) + 1j * rng.normal(size=30)).astype(np.complex64) * 30
            sender.add_channel(
                step, t_ns, 7 * step * step % 997 + 1000 * step, csi, power_dbm=-50 - step % 7, antenna=0
            )
        if step % 100 == 99:
            for data in sender.datagrams(t_ns):
                link.send(data)
    link.close()
    after = sent_bytes("left")
    assert before is not None
    assert after is not None
    print(f"bytes {after - before} counted {sender.sent_bytes} thinned {sender.thinned}")


def addresses() -> None:
    """A datagram to each kind of address, and whether it left by the interface and came back to its sender."""
    subprocess.run(["ip", "addr", "add", "10.9.0.1/24", "broadcast", "10.9.0.255", "dev", "left"], check=True)
    for address, interface in (
        ("10.9.0.255", "left"),
        ("255.255.255.255", "left"),
        ("239.1.2.3", "left"),
        ("239.1.2.3", None),
        ("10.99.0.255", "left"),
        ("10.9.0.255", "nosuch"),
    ):
        before = sent_bytes("left")
        try:
            link = Link(
                dataclasses.replace(
                    CONFIG, neighbours=NeighbourConfig(key_file="k", port=17650, broadcast=address, interface=interface)
                )
            )
        except CompanionError as error:
            print("refused", error)
            continue
        link.send(bytes(500))
        time.sleep(0.05)
        after = sent_bytes("left")
        assert before is not None
        assert after is not None
        print("heard", len(link.drain()), "left", after - before >= 542)
        link.close()


if __name__ == "__main__":
    make_pair()
    if sys.argv[1] == "fields":
        fields()
    elif sys.argv[1] == "vht":
        vht()
    elif sys.argv[1] == "datagrams":
        datagrams()
    elif sys.argv[1] == "addresses":
        addresses()
    else:
        asyncio.run({"echo": echo, "exchange": exchange, "rate": rate}[sys.argv[1]]())
