"""`companion feed` into the real connector at the recorded pace, and `companion doctor radio` listening to it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from companion.config.file import load_config
from companion.radio.checks import System, static_checks
from csi_bridge.netlink import NetlinkSource
from csi_bridge.parser import parse_body
from csi_bridge.records import CsiRecord
from csi_bridge.replay import read_tape
from tests.connectors import claimed, needs_netlink
from tests.csi_records import needs_data
from tests.paths import CONFIGS, DATA

RUN = DATA / "wsr_dataset_dev/LOS_Set_A/0627_2D-multi-link_A_L2"
SAMPLE = DATA / "csi_samples" / "sample_0x5_64_3000.dat"


@pytest.fixture
def groups() -> Iterator[list[int]]:
    with claimed(2) as indices:
        yield indices


@pytest.fixture
def idx(groups: list[int]) -> int:
    return groups[0]


def companion(*arguments: str | Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "companion", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@needs_data
@needs_netlink
def test_feed_plays_every_record_in_order_at_its_pace(idx: int, tmp_path: Path) -> None:
    source = NetlinkSource(idx, require_kernel_sender=False, receive_buffer_bytes=16 << 20)
    started_s = time.monotonic()
    process = companion("feed", SAMPLE, "--connector-idx", str(idx), "--rate", "2", "--json", tmp_path / "r.json")
    heard: list[tuple[int, bytes]] = []
    while process.poll() is None:
        heard += source.drain()
        time.sleep(0.01)
    heard += source.drain()
    source.close()
    out, err = process.communicate()
    assert process.returncode == 0, err
    assert heard == list(read_tape(SAMPLE).records)
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["records"] == result["taken"] == len(heard) == 5996
    assert result["seconds"] >= result["recorded_s"] / 2 - 0.1
    assert time.monotonic() - started_s >= 1.4
    assert "5996 records" in out


@needs_data
def test_a_tape_keeps_the_mpdu_before_its_csi_and_the_times_of_the_host() -> None:
    tape = read_tape(SAMPLE)
    assert [code for code, _ in tape.records[:4]] == [0xC1, 0xBB, 0xC1, 0xBB]
    assert (tape.t_s[0::2] == tape.t_s[1::2]).all()
    assert tape.t_s[0] < 1e9, "of the card's own clock"
    recorded = read_tape(next(RUN.glob("csi_rx*.dat")))
    assert recorded.t_s[0] > 1e9, "of the day"
    first = parse_body(*recorded.records[0])
    assert isinstance(first, CsiRecord)
    assert first.host_time_ns is not None
    assert abs(recorded.t_s[0] - first.host_time_ns * 1e-9) < 1e-6
    assert len(recorded.between(recorded.t_s[0], recorded.t_s[0] + 1.0)) > 300


def test_a_file_that_is_no_log_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "no.dat").write_bytes(b"nothing of the kind" * 10)
    process = companion("feed", tmp_path / "no.dat")
    _, err = process.communicate(timeout=30)
    assert process.returncode == 1
    assert "not a CSI log" in err
    assert "Traceback" not in err


@needs_data
def test_feed_says_when_there_is_no_service_to_hear_it(tmp_path: Path) -> None:
    _feed_nobody("--unix", tmp_path / "nobody.sock")


@needs_data
@needs_netlink
def test_feed_says_when_nobody_listens_to_the_connector(idx: int) -> None:
    _feed_nobody("--connector-idx", str(idx))


def _feed_nobody(*where: str | Path) -> None:
    process = companion("feed", SAMPLE, *where)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "start the service first" in err
    assert "Traceback" not in err


@needs_data
@needs_netlink
def test_doctor_finds_the_group_that_the_driver_really_reports_in(groups: list[int], tmp_path: Path) -> None:
    idx, other = groups
    config = yaml.safe_load((CONFIGS / "demo-uav.yaml").read_text())
    config["csi"]["connector_idx"] = other
    (tmp_path / "uav.yaml").write_text(yaml.safe_dump(config))
    doctor = companion("doctor", "radio", "--config", tmp_path / "uav.yaml", "--seconds", "6")
    feed = companion("feed", next(RUN.glob("csi_rx*.dat")), "--connector-idx", str(idx))
    while doctor.poll() is None:
        if feed.poll() is not None:  # nobody listened yet
            feed.communicate()
            feed = companion("feed", next(RUN.glob("csi_rx*.dat")), "--connector-idx", str(idx))
        time.sleep(0.05)
    out, _ = doctor.communicate(timeout=60)
    feed.terminate()
    feed.communicate()
    assert re.search(rf"records came elsewhere: .*\d+ in group {idx}\b.*set csi.connector_idx", out), out
    assert doctor.returncode == 1


@needs_data
@needs_netlink
def test_doctor_sees_the_antennas_and_packets_of_a_fed_recording(idx: int, tmp_path: Path) -> None:
    config = yaml.safe_load((CONFIGS / "demo-uav.yaml").read_text())
    config["csi"]["connector_idx"] = idx
    (tmp_path / "uav.yaml").write_text(yaml.safe_dump(config))
    doctor = companion(
        "doctor", "radio", "--config", tmp_path / "uav.yaml", "--seconds", "10", "--json", tmp_path / "d.json"
    )
    feed = companion("feed", next(RUN.glob("csi_rx*.dat")), "--connector-idx", str(idx), "--rate", "1")
    out, _ = doctor.communicate(timeout=60)
    feed.terminate()
    feed.communicate()
    checks = {check["name"]: check for check in json.loads((tmp_path / "d.json").read_text())}
    assert checks["connector"]["ok"] is True
    assert checks["counters"]["ok"] is True
    assert checks["antennas"]["ok"] is True
    assert "A -" in checks["antennas"]["found"]
    assert checks["packets of beacon"]["ok"] is True
    assert checks["clock lock"]["ok"] is True
    # There is no card here, and it says what to do about that.
    assert checks["card"]["ok"] is False and "8086:4235" in checks["card"]["found"]
    assert checks["driver"]["ok"] is None
    assert doctor.returncode == 1
    assert "FAILED card" in out


def test_doctor_reads_what_the_kernel_shows_of_a_card(tmp_path: Path) -> None:
    config_file = CONFIGS / "uav.yaml"
    document = yaml.safe_load(config_file.read_text())
    document["csi"]["interface"] = "mon0"
    (tmp_path / "uav.yaml").write_text(yaml.safe_dump(document))
    config = load_config(tmp_path / "uav.yaml")
    system = System(tmp_path / "module", tmp_path / "net", tmp_path / "debug")

    def checks() -> dict[str, bool | None]:
        return {check.name: check.ok for check in static_checks(config, system)}

    assert checks()["driver"] is False
    (system.modules / "iwldvm").mkdir(parents=True)
    assert checks()["driver"] is False  # loaded, and the stock one
    parameters = system.modules / "iwlwifi" / "parameters"
    parameters.mkdir(parents=True)
    (parameters / "connector_log").write_text("0\n")
    assert checks()["driver"] is True
    assert checks()["connector_log"] is False
    (parameters / "connector_log").write_text("1\n")
    assert checks()["connector_log"] is True
    assert checks()["interface"] is False
    folder = system.networks / "mon0"
    folder.mkdir(parents=True)
    (folder / "type").write_text("1\n")
    (folder / "operstate").write_text("down\n")
    assert checks()["interface"] is False
    assert checks()["interface up"] is False
    (folder / "type").write_text("803\n")
    (folder / "operstate").write_text("unknown\n")
    assert checks()["interface"] is True
    assert checks()["interface up"] is True
    assert checks()["channel"] is None  # the kernel has no such interface to ask
