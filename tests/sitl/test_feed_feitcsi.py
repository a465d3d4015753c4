"""`companion feed` of an AX card's log: told by its content, into the socket and into generic netlink."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path

import pytest

from csi_bridge.feitcsi.netlink import VendorEventSource, vendor_events_available
from csi_bridge.replay import read_tape
from csi_bridge.source import CsiSource
from csi_bridge.unix_socket import UnixSource
from tests.feit_records import CAPTURES, needs_captures
from tests.sitl.test_feed_and_doctor import companion

IDX = 15
UNAVAILABLE = vendor_events_available(IDX)
VIA = (
    "unix",
    pytest.param(
        "netlink", marks=pytest.mark.skipif(UNAVAILABLE is not None, reason=f"generic netlink: {UNAVAILABLE}")
    ),
)


@needs_captures
@pytest.mark.parametrize("via", VIA)
def test_feed_plays_every_report_at_its_pace(via: str, tmp_path: Path) -> None:
    log = tmp_path / "named as another card's.dat"
    shutil.copy(CAPTURES / "HESU80_5500.csi", log)
    unix = tmp_path / "csi.sock"
    source: CsiSource = UnixSource(unix) if via == "unix" else VendorEventSource(None, False, idx=IDX)
    where = ("--unix", unix) if via == "unix" else ("--connector-idx", str(IDX))
    process = companion("feed", log, *where, "--rate", "4", "--json", tmp_path / "r.json")
    heard = []
    while process.poll() is None:
        heard += source.drain()
        time.sleep(0.01)
    heard += source.drain()
    source.close()
    _, err = process.communicate()
    assert process.returncode == 0, err
    tape = read_tape(log)
    assert heard == list(tape.records)
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["records"] == result["taken"] == len(heard) == 28
    assert result["seconds"] >= result["recorded_s"] / 4 - 0.1
    assert 1.9 < tape.duration_s < 2.1 and tape.t_s[0] < 1e9


@needs_captures
def test_feed_says_when_there_is_no_service_to_hear_it(tmp_path: Path) -> None:
    processes = [companion("feed", CAPTURES / "HT20_2452.csi", "--unix", tmp_path / "nobody.sock")]
    if UNAVAILABLE is None:
        processes.append(companion("feed", CAPTURES / "HT20_2452.csi", "--connector-idx", "31"))
    for process in processes:
        _, err = process.communicate(timeout=60)
        assert process.returncode == 1
        assert "start the service first" in err
        assert "Traceback" not in err
