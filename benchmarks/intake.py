"""The radio's way in: logs from file, records live, and a crowd of neighbours through real sockets."""

from __future__ import annotations

import asyncio
import multiprocessing
import socket
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.synchronize import Event
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.timing import best_s
from companion.config.schema import Config, CsiConfig, NeighbourConfig
from companion.core.clock import NS_PER_S, MonotonicClock
from companion.neighbours import wire
from companion.neighbours.bands import grid_of
from companion.neighbours.link import Link
from companion.neighbours.receiver import NeighbourReceiver
from companion.neighbours.sender import BYTES_PER_S, NeighbourSender
from companion.radio.card import Radio
from companion.replay.recorded import RecordedCsi, ReplayClock
from companion.sensing.window import SarWindow
from csi_bridge.dat import read_dat
from csi_bridge.encoder import encode_body, encode_file_record
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.message import decode_event, encode_event
from csi_bridge.feitcsi.netlink import VendorEventFeeder, VendorEventSource, vendor_events_available
from csi_bridge.feitcsi.rate import Rate
from csi_bridge.feitcsi.records import FEITCSI_CODE, HEADER_BYTES, TICKS_PER_US, FeitRecord
from csi_bridge.netlink import NetlinkFeeder, NetlinkSource, connector_available
from csi_bridge.records import CSI_CODE, CsiRecord
from csi_bridge.replay import Feeder
from csi_bridge.source import CsiSource
from csi_bridge.unix_socket import UnixFeeder, UnixSource

RATE_HZ = 150.0
CONNECTOR = 16
_RECORDS = 50_000
_DATAGRAMS = 500
CURVE = (5, 10, 20, 40, 60, 80, 120, 160)
_KEY = bytes(32)
_WIDE_BYTES_S = 12_000
"""Room for every channel of 80 MHz at this rate."""


@dataclass(frozen=True, slots=True)
class Throughput:
    """Records a second from file; microseconds for one on the live path (parsed, stamped, kept, paired), for a report
    of an AX card there (996 subcarriers on two chains, from its netlink message on), and for one datagram of 15
    channels and 5 poses: checked and unpacked."""

    batch_per_s: float
    live_us: float
    live_80mhz_us: float
    datagram_us: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Crowd:
    """So many neighbours at 150 packets and 10 datagrams a second each, for `seconds`: what was lost and what it
    took."""

    neighbours: int
    seconds: float
    packets: int
    packets_lost: int
    datagrams: int
    datagrams_lost: int
    overruns: int
    share_of_a_core: float


def throughput() -> Throughput:
    bodies = [(CSI_CODE, encode_body(_record(number, number % 3))) for number in range(2000)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.dat"
        log = b"".join(encode_file_record(code, body) for code, body in bodies)
        path.write_bytes(log * (_RECORDS // len(bodies)))
        batch_s = best_s(lambda: read_dat(path))
    live_s, data = best_s(lambda: _take_all(bodies)), _datagram()
    datagram_s = best_s(lambda: [wire.decode(data, [_KEY]) for _ in range(_DATAGRAMS)])
    return Throughput(
        batch_per_s=_RECORDS / batch_s,
        live_us=1e6 * live_s / len(bodies),
        live_80mhz_us=live_80mhz_us(),
        datagram_us=1e6 * datagram_s / _DATAGRAMS,
    )


def live_80mhz_us() -> float:
    events = [encode_event(encode_record(_report(number, number % 3))) for number in range(500)]
    return 1e6 * best_s(lambda: _take_all([(FEITCSI_CODE, decode_event(event)) for event in events])) / len(events)


def crowd(neighbours: int, seconds: float, at_80mhz: bool = False) -> Crowd:
    """A process of its own sends, packets of a 5300 or of an AX card; this one is the service's intake, and its CPU
    time is counted."""
    context = multiprocessing.get_context("spawn")
    ready, done = context.Event(), context.Event()
    with tempfile.TemporaryDirectory() as folder:
        port = _free_port()
        source = _source(Path(folder) / "csi", at_80mhz)
        arguments = (neighbours, seconds, port, folder, at_80mhz, ready, done)
        sender = context.Process(target=_send, args=arguments)
        sender.start()
        try:
            return asyncio.run(_take(neighbours, seconds, port, source, ready=ready, done=done))
        finally:
            sender.join()
            source.close()


def _source(path: Path, at_80mhz: bool) -> CsiSource:
    if at_80mhz and vendor_events_available(CONNECTOR) is None:
        return VendorEventSource(None, False, 4 << 20, CONNECTOR)
    if not at_80mhz and connector_available(CONNECTOR) is None:
        return NetlinkSource(CONNECTOR, False, 4 << 20)
    return UnixSource(path, 4 << 20)


def _feeder(path: Path, at_80mhz: bool) -> Feeder:
    if at_80mhz:
        return VendorEventFeeder(CONNECTOR) if vendor_events_available(CONNECTOR + 1) is None else UnixFeeder(path)
    return NetlinkFeeder(CONNECTOR) if connector_available(CONNECTOR) is None else UnixFeeder(path)


async def _take(neighbours: int, seconds: float, port: int, source: CsiSource, *, ready: Event, done: Event) -> Crowd:
    clock = MonotonicClock()
    ids = range(2, 2 + neighbours)
    link = Link(_config(port))
    receiver = NeighbourReceiver(1, {i: f"n{i}" for i in ids}, {i: [_KEY] for i in ids}, clock)
    window = SarWindow(antenna_m=(0.0, 0.0, 0.0), wavelength_m=0.054, min_packets=20, max_pose_gap_s=0.05)

    def on_sample(sample) -> None:  # type: ignore[no-untyped-def]
        receiver.neighbours[sample.peer].add_forward(sample.frame, sample.t_mono_ns, sample.nic_us)
        window.add_sample(sample)

    radio = Radio(
        source=source, peers={_mac(i): i for i in ids}, clock=clock, on_sample=on_sample, on_record=lambda *_: None
    )

    def drain() -> None:
        for data in link.drain():
            receiver.take(data)

    loop = asyncio.get_running_loop()
    loop.add_reader(source.fileno(), radio.drain)
    loop.add_reader(link.fileno(), drain)
    await asyncio.to_thread(ready.wait)
    used_s, start_s = time.process_time(), time.monotonic()
    waiting = asyncio.create_task(asyncio.to_thread(done.wait))
    while not waiting.done():
        await asyncio.wait([waiting], timeout=1.0)
        for neighbour in receiver.neighbours.values():
            neighbour.relate_uncounted(clock.now_ns())
    await asyncio.sleep(0.3)
    used_s, wall_s = time.process_time() - used_s, time.monotonic() - start_s
    loop.remove_reader(source.fileno())
    loop.remove_reader(link.fileno())
    link.close()
    accepted = sum(n.accepted for n in receiver.neighbours.values())
    packets, datagrams = round(seconds * RATE_HZ) * neighbours, round(seconds * 10) * neighbours
    return Crowd(
        neighbours=neighbours, seconds=seconds, packets=packets, packets_lost=packets - radio.counters.samples,
        datagrams=datagrams, datagrams_lost=datagrams - accepted,
        overruns=source.counters.overruns, share_of_a_core=used_s / wall_s,
    )  # fmt: skip


def _send(neighbours: int, seconds: float, port: int, folder: str, at_80mhz: bool, ready: Event, done: Event) -> None:
    """Everything is made beforehand, so that sending takes as little of the machine as it can."""
    feeder = _feeder(Path(folder) / "csi", at_80mhz)
    senders = [
        NeighbourSender(
            role=wire.Role.BEACON,
            own_id=i,
            key=_KEY,
            pose_rate_hz=50,
            boot_id=1 << 32 | i,
            budget_bytes_s=_WIDE_BYTES_S if at_80mhz else BYTES_PER_S,
        )
        for i in range(2, 2 + neighbours)
    ]
    slots = round(seconds * RATE_HZ)
    band = _report(0, 0).rate.layout if at_80mhz else 0
    bodies = [encode_record(_report(0, i)) if at_80mhz else encode_body(_record(0, i)) for i in range(neighbours)]
    rng = np.random.default_rng(1)
    parts = 100 * rng.normal(size=(2, grid_of(band).size)) if at_80mhz else np.tile([[20.0], [5.0]], 30)
    csi = (parts[0] + 1j * parts[1]).astype(np.complex64)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        ready.set()
        start_ns = time.monotonic_ns()
        for slot in range(slots):
            due_ns = start_ns + round(slot / RATE_HZ * NS_PER_S)
            while (left_ns := due_ns - time.monotonic_ns()) > 0:
                time.sleep(left_ns / NS_PER_S)
            stamp_us = (due_ns // 1000) & 0xFFFFFFFF
            for i, body in enumerate(bodies):
                ticks = stamp_us * TICKS_PER_US & 0xFFFFFFFF
                if at_80mhz:
                    head = body[:8] + ticks.to_bytes(4, "little") + body[12:88] + stamp_us.to_bytes(4, "little")
                    feeder.send(FEITCSI_CODE, head + body[92:])
                else:
                    count = (slot * neighbours + i) & 0xFFFF
                    head = stamp_us.to_bytes(4, "little") + count.to_bytes(2, "little")
                    feeder.send(CSI_CODE, head + body[6:34] + slot.to_bytes(4, "little") + body[38:])
                frame = None if at_80mhz else slot
                senders[i].add_channel(
                    frame, due_ns - 300_000, stamp_us, csi, power_dbm=-50.0, antenna=0, band=band, ticks=ticks
                )
                if slot % 3 == 0:
                    senders[i].add_pose(due_ns, (0.0, 0.0, 0.0), 3)
                # Each has its own phase: ten datagrams a second, not all at once.
                if slot % 15 == i % 15:
                    for data in senders[i].datagrams(time.monotonic_ns()):
                        out.sendto(data, ("127.255.255.255", port))
    feeder.close()
    done.set()


def _take_all(bodies: list[tuple[int, bytes]]) -> None:
    clock = ReplayClock(NS_PER_S)
    receiver = NeighbourReceiver(1, {i: str(i) for i in range(2, 5)}, {i: [_KEY] for i in range(2, 5)}, clock)
    window = SarWindow(antenna_m=(0.0, 0.0, 0.0), wavelength_m=0.054, min_packets=20, max_pose_gap_s=0.05)

    def on_sample(sample) -> None:  # type: ignore[no-untyped-def]
        receiver.neighbours[sample.peer].add_forward(sample.frame, sample.t_mono_ns, sample.nic_us)
        window.add_sample(sample)

    source = RecordedCsi()
    source.add(bodies)
    Radio(
        source=source,
        peers={_mac(i): i for i in range(2, 5)},
        clock=clock,
        on_sample=on_sample,
        on_record=lambda *_: None,
    ).drain()


def _datagram() -> bytes:
    """A tenth of a second of a beacon at 150 packets."""
    sender, rng = (
        NeighbourSender(role=wire.Role.BEACON, own_id=2, key=_KEY, pose_rate_hz=50, boot_id=1 << 32),
        np.random.default_rng(1),
    )
    for slot in range(15):
        t_ns = NS_PER_S + slot * 6_666_667
        csi = (30 * (rng.normal(size=30) + 1j * rng.normal(size=30))).astype(np.complex64)
        sender.add_channel(slot, t_ns, t_ns // 1000, csi, power_dbm=-50.0, antenna=0)
        if slot % 3 == 0:
            sender.add_pose(t_ns, (1e-2 * slot, 0.0, 0.0), 3)
    (data,) = sender.datagrams(NS_PER_S * 11 // 10)
    return data


def _record(number: int, neighbour: int) -> CsiRecord:
    parts = np.random.default_rng(number % 50).integers(-40, 40, (2, 30, 3, 1))
    return CsiRecord(
        timestamp_low_us=number * 2000, bfee_count=number & 0xFFFF, n_rx=3, n_tx=1, rssi=(40, 20, 18), noise_dbm=-92,
        agc=40, antenna_sel=(0b10_01_00, 0b01_10_00)[number % 2], rate=0x101,
        csi=(parts[0] + 1j * parts[1]).astype(np.complex64), layout=38, host_time_ns=NS_PER_S,
        mac=_mac(neighbour + 2), frame_count=number,
    )  # fmt: skip


def _report(number: int, neighbour: int) -> FeitRecord:
    """HE, 80 MHz, both chains."""
    parts = np.random.default_rng(number % 50).integers(-300, 300, (2, 996, 2, 1))
    return FeitRecord(
        ftm_ticks=number * 640_000, host_time_us=0, rssi_dbm=(-40, -42), mac=_mac(neighbour + 2),
        timestamp_low_us=number * 2000, rate=Rate(4 << 8 | 2 << 11 | 0b11 << 14),
        csi=(parts[0] + 1j * parts[1]).astype(np.complex64), header=bytes(HEADER_BYTES),
    )  # fmt: skip


def _mac(neighbour: int) -> bytes:
    return bytes([0, 0x21, 0x6A, 0, 0, neighbour])


def _config(port: int) -> Config:
    return Config(
        role="beacon",
        id=1,
        name="bench",
        csi=CsiConfig(108),
        neighbours=NeighbourConfig(key_file="-", port=port),
        peers=[],
    )


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.255.255.255", 0))
        return int(probe.getsockname()[1])


def crowds(seconds: float, curve_seconds: float) -> Iterator[Crowd]:
    """20 neighbours for `seconds`, then more and more of them for `curve_seconds` each until packets are lost."""
    yield crowd(20, seconds)
    for neighbours in CURVE:
        row = crowd(neighbours, curve_seconds)
        yield row
        if row.packets_lost > 0.05 * row.packets:
            return


def line(row: Crowd, of: str = "neighbours") -> str:
    return (
        f"{row.neighbours:>4} {of}, {row.seconds:g} s: {row.packets_lost} of {row.packets} packets and "
        f"{row.datagrams_lost} of {row.datagrams} datagrams lost, {100 * row.share_of_a_core:.0f} % of a core"
    )


def plot(rows: list[Crowd], out: Path) -> None:
    figure = Figure(figsize=(6, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    count = [row.neighbours for row in rows]
    axes.plot(count, [100 * row.share_of_a_core for row in rows], "k-o", label="of a core")
    axes.plot(count, [100 * row.packets_lost / row.packets for row in rows], "k:s", label="packets lost")
    axes.set(xlabel="neighbours at 150 packets/s", ylabel="%", title="intake", ylim=(0, None))
    axes.legend()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "intake.png", dpi=120)
