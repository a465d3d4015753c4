"""`companion csi`: logs of both cards by their content, damage, and files of other tools."""

from __future__ import annotations

import gzip
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from companion.cli import program
from companion.errors import CompanionError
from csi_bridge.feitcsi.encoder import encode_record
from tests import csi_records, feit_records
from tests.csi_records import log_of, needs_data
from tests.feit_records import CAPTURES, needs_captures, write_log
from tests.paths import DATA


def companion_csi(*arguments: str | Path) -> Result:
    return CliRunner().invoke(program, ["csi", *map(str, arguments)])


def described(tmp_path: Path, file: Path) -> dict[str, Any]:
    result = companion_csi(file, "--json", tmp_path / "content.json")
    assert result.exit_code == 0, result.output
    (content,) = json.loads((tmp_path / "content.json").read_text())
    assert isinstance(content, dict)
    return content


@needs_captures
@pytest.mark.parametrize(
    ("name", "count", "width_mhz", "subcarriers"),
    [("HESU160_5500", 26, 160, 1992), ("VHT80_5500", 40, 80, 242), ("HT20_2452", 48, 20, 56)],
)
def test_a_capture_is_described_whatever_its_name(
    tmp_path: Path, name: str, count: int, width_mhz: int, subcarriers: int
) -> None:
    log = tmp_path / "log.dat"
    shutil.copy(CAPTURES / f"{name}.csi", log)
    content = described(tmp_path, log)
    assert content["format"].startswith("FeitCSI")
    assert content["records"] == {"whole": count, "damaged": 0, "cut_off": 0, "skipped_bytes": 0, "cut_off_bytes": 0}
    assert (content["widths_mhz"], content["subcarriers"]) == ([width_mhz], [subcarriers])
    assert content["senders"] == {"00:16:EA:12:34:56": count}
    assert set(content["antennas"]) == {"A", "B"} and all(-60 < power < -30 for power in content["antennas"].values())
    assert content["rate_hz"] == pytest.approx((count - 1) / content["span_s"])
    assert [clock["name"] for clock in content["clocks"]] == ["card", "card, fine"]


@needs_data
def test_a_recorded_log_of_the_other_card_is_described(tmp_path: Path) -> None:
    log = next((DATA / "wsr_dataset_dev/LOS_Set_A/0627_2D-multi-link_A_L2").glob("csi_rx*.dat"))
    content = described(tmp_path, log)
    assert content["format"] == "Intel 5300, header of 38 bytes"
    assert (content["widths_mhz"], content["subcarriers"], content["records"]["cut_off"]) == ([20], [30], 1)
    assert len(content["senders"]) == 3
    assert content["antennas"]["A"] > content["antennas"]["B"] + 20


def test_pictures_are_drawn_for_both_cards(tmp_path: Path) -> None:
    write_log(tmp_path / "ax.csi", [feit_records.record(stamp_us=1000 * number) for number in range(3)])
    (tmp_path / "old.dat").write_bytes(log_of([csi_records.record(seed=number) for number in range(3)]))
    result = companion_csi(tmp_path / "ax.csi", tmp_path / "old.dat", "--out", tmp_path / "pictures")
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == ["ax.csi.png", "old.dat.png"]


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (gzip.compress(log_of([csi_records.record()])), "gzip: unpack it first"),
        (b"\xd4\xc3\xb2\xa1" + bytes(36) + b"\x15\x7c" + b"\x11\x11" + bytes(60), "nexmon CSI"),
        (b"CSI_DATA,0,a8:03:2a:b6:f4:54,-53,11,1,0\n", "ESP32 CSI"),
        (b"\x00\x02\x00\x00\x15\x03\x15\x20" + bytes(200), "PicoScenes"),
        (b"\x01\x02\x03" * 50, "not a CSI log"),
        (b"", "empty file"),
        (encode_record(feit_records.record())[:300], "a FeitCSI log without a whole record: 300 bytes of one"),
    ],
)
def test_files_of_other_tools_are_named_and_the_rest_is_read(tmp_path: Path, content: bytes, named: str) -> None:
    (tmp_path / "other").write_bytes(content)
    (tmp_path / "good.dat").write_bytes(log_of([csi_records.record()] * 2))
    result = companion_csi(tmp_path / "other", tmp_path / "good.dat")
    assert isinstance(result.exception, CompanionError)
    assert "1 of 2 files could not be read" in str(result.exception)
    (line,) = [line for line in result.output.splitlines() if line.startswith("companion:")]
    assert named in line
    assert "Intel 5300, header of 38 bytes" in result.output
