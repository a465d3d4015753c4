"""Other tools' files are named, in the one line that refuses them."""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import pytest

from csi_bridge.dat import read_dat
from csi_bridge.dat_frames import DatFileError
from csi_bridge.replay import read_tape

NEXMON = (
    struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    + struct.pack("<IIII", 1, 0, 60 + 1024, 60 + 1024)
    + bytes(12) + b"\x08\x00" + b"\x45" + bytes(19) + struct.pack(">HHHH", 5500, 5500, 1000, 0)
    + b"\x11\x11" + bytes(1040)
)  # fmt: skip
PICOSCENES = struct.pack("<IIHBB", 400, 0x20150315, 1, 3, 0) + struct.pack("<IB", 60, 9) + b"RxSBasic\0" + bytes(380)
FEITCSI = bytearray(272 + 4 * 2 * 56)
struct.pack_into("<I", FEITCSI, 0, 4 * 2 * 56)
FEITCSI[46:48] = b"\x02\x01"
struct.pack_into("<I", FEITCSI, 52, 56)
ESP32 = b"type,seq,mac,rssi,rate,sig_mode,mcs,bandwidth\nCSI_DATA,0,1a:00:00:00:00:00,-40,11,1,0,0,[1,2,3]\n"


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (NEXMON, "a pcap capture of nexmon CSI"),
        (NEXMON[:24] + bytes(100), "a pcap capture;"),
        (PICOSCENES, "a PicoScenes log"),
        (bytes(FEITCSI), "a FeitCSI log"),
        (ESP32, "ESP32 CSI as text"),
        (gzip.compress(b"abc" * 100, mtime=0), "gzip: unpack it first"),
        (bytes(8192), "all zero"),
        (b"sec,nsec,x,y,z\n" * 30, "a text file"),
        (b"\x89MCAP0\r\n" + bytes(100), "an MCAP log"),
        (b"\x89HDF\r\n\x1a\n" + bytes(100), "an HDF5"),
        (b"#ROSBAG V2.0\n" + bytes(100), "a rosbag of ROS 1"),
        (struct.pack(">Q", 1_700_000_000_000_000) + b"\xfd" + bytes(20), "a telemetry log of MAVLink"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:ab\n", "a pointer of Git LFS"),
        (b"<!DOCTYPE html><html>", "a web page"),
        (b"\xff" * 300, "0 CSI records in 300 bytes"),
    ],
)
def test_a_foreign_file_is_named(tmp_path: Path, content: bytes, named: str) -> None:
    path = tmp_path / "csi_rx.dat"
    path.write_bytes(content)
    for read in (read_dat, read_tape):
        with pytest.raises(DatFileError, match=rf"csi_rx\.dat: not a CSI log \({named}.*; expected one of the Intel"):
            read(path)


def test_what_is_no_file_is_not_waited_for(tmp_path: Path) -> None:
    with pytest.raises(DatFileError, match="a device, expected a file"):
        read_dat(Path("/dev/zero"))
    with pytest.raises(DatFileError, match="directory"):
        read_dat(tmp_path)
