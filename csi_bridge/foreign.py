"""Other tools' files, told by their first bytes, so that a person hears what a file is and not only what it is not."""

from __future__ import annotations

import codecs
from collections.abc import Callable
from typing import Final

TEXT: Final = "a text file"
_PCAP: Final = (b"\xa1\xb2\xc3\xd4", b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\x3c\x4d", b"\x4d\x3c\xb2\xa1")
_NEXMON_PORT: Final = (5500).to_bytes(2, "big")
_MAGIC: Final[tuple[tuple[bytes, str], ...]] = (
    (b"\x1f\x8b", "gzip: unpack it first"),
    (b"BZh", "bzip2: unpack it first"),
    (b"\xfd7zXZ\x00", "xz: unpack it first"),
    (b"\x28\xb5\x2f\xfd", "zstd: unpack it first"),
    (b"PK\x03\x04", "a zip archive: unpack it first"),
    (b"\x89MCAP0\r\n", "an MCAP log: see companion log info"),
    (b"MATLAB 5.0", "a MATLAB file"),
    (b"\x93NUMPY", "a NumPy file"),
    (b"\x0a\x0d\x0d\x0a", "a pcapng capture"),
    (b"\x89HDF\r\n", "an HDF5 or MATLAB 7.3 file"),
    (b"PAR1", "a Parquet file"),
    (b"SQLite format 3", "an SQLite database, as rosbag2's .db3: give the folder of the bag"),
    (b"#ROSBAG V", "a rosbag of ROS 1: rosbags-convert makes a rosbag2 of it"),
    (b"ULog", "a ULog of PX4: see companion log merge --ulg"),
    (b"\xa3\x95\x80", "a log of ArduPilot"),
    (b"%PDF-", "a PDF"),
    (b"version https://git-lfs", "a pointer of Git LFS and not the file: git lfs pull fetches it"),
    (b"/annex/objects", "a pointer of git-annex and not the file"),
    (b"<!DOCTYPE", "a web page: was it downloaded?"),
    (b"<html", "a web page: was it downloaded?"),
    (b"<?xml", "an XML file"),
    (b"QGC WPL", "a mission of QGroundControl"),
)
_EPOCH_US: Final = (946_684_800_000_000, 4_102_444_800_000_000)
"""2000 to 2100."""


def foreign_format(start: bytes) -> str:
    """What a file that begins with `start` (a few kilobytes) is; empty where it cannot be told."""
    for magic, what in _MAGIC:
        if start.startswith(magic):
            return what
    return next((what for is_it, what in _CONTENTS if is_it(start)), "")


def _is_nexmon(start: bytes) -> bool:
    """A capture of UDP datagrams to port 5500, whose payload begins 11 11 (older firmware: four times 11)."""
    return start.startswith(_PCAP) and (b"\x11\x11" in start[40:128] and _NEXMON_PORT in start[40:128])


def _is_picoscenes(start: bytes) -> bool:
    """Each of its frames is made of named segments, the first of them RxSBasic; its header's magic is 0x20150315."""
    return b"RxSBasic" in start[:256] or start[4:8] == (0x20150315).to_bytes(4, "little")


def _is_tlog(start: bytes) -> bool:
    """Each MAVLink frame behind the wall time [us] of its arrival."""
    return start[8:9] in (b"\xfd", b"\xfe") and _EPOCH_US[0] < int.from_bytes(start[:8], "big") < _EPOCH_US[1]


def _is_json(start: bytes) -> bool:
    return _is_text(start) and start.lstrip()[:1] in (b"{", b"[")


def _is_text(start: bytes) -> bool:
    try:
        codecs.getincrementaldecoder("utf-8")().decode(start)  # which may end within a letter
    except UnicodeDecodeError:
        return False
    return bool(start) and not any(byte < 9 for byte in start)


def _is_esp32(start: bytes) -> bool:
    return _is_text(start) and (b"CSI_DATA" in start or (b"rssi" in start.lower() and b"sig_mode" in start.lower()))


def _is_feitcsi(start: bytes) -> bool:
    """Its header: u32 bytes of data, antennas at 46 and 47, u32 subcarriers at 52; four bytes a value."""
    if len(start) < 272:
        return False
    size, tones = (int.from_bytes(start[at : at + 4], "little") for at in (0, 52))
    return size > 0 and size == 4 * start[46] * start[47] * tones


_CONTENTS: Final[tuple[tuple[Callable[[bytes], bool], str], ...]] = (
    (lambda start: bool(start) and not any(start), "all zero: the logger wrote pages and no data"),
    (_is_nexmon, "a pcap capture of nexmon CSI"),
    (lambda start: start.startswith(_PCAP), "a pcap capture"),
    (_is_picoscenes, "a PicoScenes log"),
    (_is_feitcsi, "a FeitCSI log (AX200, AX210)"),
    (_is_tlog, "a telemetry log of MAVLink (.tlog)"),
    (_is_esp32, "ESP32 CSI as text"),
    (_is_json, "a JSON file"),
    (_is_text, TEXT),
)
