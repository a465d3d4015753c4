"""Every command of ours that a document prints as a block, and what becomes of it in a fresh clone without hardware.

`RUN` is run as printed, in this order, with a name in capitals replaced; `NOT_RUN` says why not, and what runs it
instead. A command that is in neither fails a test.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from tests.paths import DOCS, ROOT

PAGES: Final = (ROOT / "README.md", *sorted(DOCS.glob("*.md")))
_RECORDING: Final = "recording/csi_rx_2023-11-14_221320.dat"
_OTHER_END: Final = "recording/csi_tx2_2023-11-14_221320.dat"


@dataclass(frozen=True, slots=True)
class Run:
    """A command as printed, what its names stand for, and how it ends. `says` is in what it prints."""

    words: str
    names: Mapping[str, str] = field(default_factory=dict)
    code: int = 0
    says: str = ""

    @property
    def command(self) -> str:
        """As a person would type it: optional parts off, names replaced, the longest first."""
        text = re.sub(r" \[[^\]]*\]", "", self.words)
        for name in sorted(self.names, key=len, reverse=True):
            text = text.replace(name, self.names[name])
        return text


_LOG: Final = {"LOG": "demo-out/log.mcap", "LOG...": "demo-out/log.mcap"}
RUN: Final = (
    Run("demo --recording RUN_DIRECTORY", {"RUN_DIRECTORY": "recording"}, says="azimuth 76.3"),
    Run("analyze RUN_DIRECTORY", {"RUN_DIRECTORY": "recording"}, says="azimuth"),
    Run("demo --recording DIR --card ax210", {"DIR": "wide"}, says="azimuth 76.3"),
    Run("analyze DIR", {"DIR": "wide"}, says="azimuth"),
    Run("csi FILE...", {"FILE...": f"{_RECORDING} {_OTHER_END}"}),
    Run("log import RUN [--out DIR]", {"RUN": "recording"}),
    Run("report demo-out/log.mcap -o report.html"),
    Run("report LOG [-o report.html]", _LOG),
    Run("replay demo-out/log.mcap --check"),
    Run("replay demo-out/log.mcap --config other.yaml --out DIR",
        {"other.yaml": "configs/demo-uav.yaml", "DIR": "out"}),
    Run("log info demo-out/log.mcap", says="whole"),
    Run("log info LOG...", _LOG, says="whole"),
    Run("log repair LOG [--out F]", _LOG, says="whole"),
    Run("log export LOG [--to tum|csv|dat|npz] [--ros2] [--out DIR]", _LOG),
    Run("log export demo-out/log.mcap --ros2 --out bag"),
    Run("config example uav > /etc/companion/companion.yaml", {"/etc/companion/": "./"}),
    Run("config units /etc/companion/companion.yaml", {"/etc/companion/": "./"}),
    Run("keygen /etc/companion/uav.key", {"/etc/companion/": "./"}),
    Run("keygen /etc/companion/mavlink.key", {"/etc/companion/": "./"}),
    Run("study NAME [--trials N] [--seed S] [--json F] [--out DIR] [--jobs N] [--cluster ADDRESS] [--data DIR]",
        {"NAME": "crb"}),
    Run("doctor all", code=2, says="--config names another"),
    Run("doctor system --config /etc/companion/companion.yaml", {"/etc/companion/": "./"}, 1, "FAILED"),
    Run("doctor radio --config FILE", {"FILE": "companion.yaml"}, 1, "FAILED"),
    Run("status", code=1, says="/run/companion/control.sock"),
    Run("status --json", code=1, says="/run/companion/control.sock"),
    Run("engage", code=1, says="/run/companion/control.sock"),
)  # fmt: skip

_DATA_SET: Final = "needs the public data set; test_evaluate.py runs it on what there is of it"
_HOURS: Final = "takes hours; test_study.py runs it with few trials"
_FLIGHT: Final = "a flight; tests/sitl/test_demo.py and test_mission.py fly it"
_SERVICE: Final = "needs an installed service; tests/sitl/test_install.py and test_booted.py run it"
_BAG: Final = "needs a bag of poses; test_trajectory_bag.py makes one"
NOT_RUN: Final[Mapping[str, str]] = {
    "evaluate DATA_SET_DIRECTORY --poses mocap": _DATA_SET,
    "evaluate DATA_SET_DIRECTORY --poses t265": _DATA_SET,
    "evaluate DIR --estimator robust": _DATA_SET,
    "study rendezvous --scenes occluded --trials 40": _HOURS,
    "study geometry": _HOURS,
    "study rendezvous --scenes hall,hard --trials 200 --markdown rendezvous.md --out DIR": _HOURS,
    "study rendezvous --trials 192 --seed 2 --motion fixed": _HOURS,
    "study rendezvous --trials 1100 --seed 2 --truths drawn": _HOURS,
    "study rendezvous --trials 1000 --cluster tcp://HOST:8786": _HOURS,
    "study rendezvous --trials 1000 --cluster local:4": _HOURS,
    "demo --card ax210": _FLIGHT,
    "demo --scene hard": _FLIGHT,
    "replay demo-out/log.mcap --speed 1 --live-page": "stays until Ctrl-C; test_live_page.py watches it in a browser",
    "run --config /etc/companion/companion.yaml": _SERVICE,
    "keygen --owner companion /etc/companion/uav.key": _SERVICE,
    "status --watch": _SERVICE,
    "doctor radio --rest": "needs a card; tests/sitl/test_feed_and_doctor.py has one simulated",
    "feed FILE.dat [--rate R] [--connector-idx N | --unix SOCKET]": "needs a service; test_feed_and_doctor.py has one",
    "feed FILE.csi": "needs a service; tests/sitl/test_feed_feitcsi.py has one",
    "log merge LOG OTHER... [--ulg F] --out F": "needs the log of another robot; test_merge.py makes one",
    "log import --rx rx.dat --tx tx0.dat --traj BAG": _BAG,
    "analyze --rx rx.dat --tx tx0.dat --traj 'BAG#/vicon/drone/pose'": _BAG,
    "analyze RUN --tx-traj tx2=beacon.tum --tx-time-offset tx2=-38.2 --tx-lever tx2=0.1,0,0.2":
        "needs a transmitter that moved; test_moving_ends.py makes one",
}  # fmt: skip


def printed(page: Path) -> Iterator[str]:
    """The words behind `companion` of each indented line, comments off."""
    for line in page.read_text().splitlines():
        match = re.match(r"    (?:\.venv/bin/)?companion (.*)", line)
        if match:
            yield re.split(r"  +| #", match[1])[0].strip()


def mentioned(page: Path) -> Iterator[str]:
    """The words behind `companion` of commands in running text and tables."""
    for match in re.finditer(r"`(?:sudo )?(?:\.venv/bin/)?companion ([^`]+)`", page.read_text()):
        yield " ".join(match[1].split())
