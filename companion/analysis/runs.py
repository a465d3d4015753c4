"""Recorded runs on disk: which files belong together, in the layouts of the WSR data sets or given one by one.

A run is named by the time stamp in its file names: `csi_rx_<stamp>.dat` at the receiving robot, `csi_tx<n>_<stamp>.dat`
at each transmitter (or `.csi`, as logs of an AX card are called), `rx_trajectory_<stamp>_.csv` (motion capture),
`t265_rx_trajectory...` and `odom_rx_trajectory...`.
Trajectories may stand in a folder beside that of the CSI, and `groundtruth_positions.json` above both.
"""

from __future__ import annotations

import json
import os
import re
from collections import deque
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.analysis.trajectories import PoseKind, guess_kind
from companion.errors import CompanionError
from companion.pose.trajectory_checks import MAX_POSITION_M
from csi_bridge.regular_file import open_regular
from wsr.channel import channel_frequency_hz

KNOWN_TRANSMITTERS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "00:21:6A:3E:F5:7E": "tx1",
        "00:21:6A:3F:17:5A": "tx2",
        "00:21:6A:30:D2:3C": "tx3",
        "00:21:6A:B2:6E:FA": "tx4",
    }
)
"""The radio cards of the WSR data sets."""
TRUTH_NAME: Final = "groundtruth_positions.json"
_MAX_TRUTH_BYTES: Final = 10_000_000
_MOST_FOLDERS: Final = 20_000
_EXPECTED_TRUTH: Final = "expected channel.value and true_tx_positions.value.NAME.position with x, y, z"
_CSI_NAME: Final = re.compile(r"csi_(rx|tx\d+)_(.+)\.(?:dat|csi)")
_TRANSMITTER: Final = re.compile(r"tx\d+")
_RECEIVER: Final = re.compile(r"(?<![a-z])rx(?![a-z0-9])")
_TRAJECTORY_SUFFIXES: Final = frozenset({".csv", ".tum", ".txt"})
_STAMP: Final = re.compile(r"\d{4}-\d\d-\d\d_\d{6}")

Position = npt.NDArray[np.float64]


class RecordingError(CompanionError):
    """Files of a recording are missing or wrong; the message names them."""


@dataclass(frozen=True, slots=True)
class Survey:
    """The surveyed part of a recording."""

    path: Path
    channel: int
    transmitters: Mapping[str, Position]
    """Positions (3,) by name, in the frame of motion capture; those at (0, 0, 0) are absent and left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """The files of one run. What is not there is None or left out of the mapping."""

    stamp: str
    folder: Path
    rx: Path | None
    tx: Mapping[str, Path] = field(default_factory=dict)
    trajectories: Mapping[PoseKind, Path] = field(default_factory=dict)
    ambiguous: Mapping[PoseKind, tuple[Path, ...]] = field(default_factory=dict)
    """Trajectories of which none is the run's more than the others: nobody but the user can choose."""
    tx_trajectories: Mapping[str, Path] = field(default_factory=dict)
    """Of transmitters that move, by name; each stamped by its own host's clock."""
    truth: Path | None = None
    loose: bool = False
    """The user chose the files one by one, so that none is missing."""

    @property
    def title(self) -> str:
        return printable(f"{self.set_name}/{self.folder.resolve().name} {self.stamp}")

    @property
    def set_name(self) -> str:
        """The folder above that of the run: LOS_Set_A, for example."""
        return printable(self.folder.resolve().parent.name)


def printable(text: str) -> str:
    """Names of files are bytes: those that are no UTF-8 are written \\xNN."""
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def find_runs(root: Path) -> list[Run]:
    """Every run in `root` and in the folders below it, linked ones too, by folder and time stamp. Raises RecordingError
    for none, and where two logs would be one end's."""
    try:
        with os.scandir(root):
            pass  # what is no folder, or may not be listed, is said to be so, not empty
        runs = [run for folder in sorted(_folders(root)) for run in _runs_of(folder)]
    except OSError as error:
        raise RecordingError(f"{error.filename or root}: {error.strerror}") from None
    if not runs:
        unlisted: list[OSError] = []
        list(os.walk(root, onerror=unlisted.append))
        if unlisted:
            raise RecordingError(f"{unlisted[0].filename}: {unlisted[0].strerror}")
        raise RecordingError(f"{root}: no recorded run here or below (expected files such as csi_rx_<time>.dat)")
    return runs


def loose_run(rx: Path, tx: tuple[Path, ...], trajectory: Path, kind: PoseKind | None = None) -> Run:
    """A run of files given one by one. Each transmitter is named by its file name. Raises RecordingError, also where
    their names say that the ends are swapped."""
    for path in tx:
        if _is_transmitters(rx) and _is_receivers(path) and not _is_transmitters(trajectory):
            raise RecordingError(
                f"the ends look swapped: --rx {rx} is a transmitter's log by its name, and --tx {path} the receiving "
                "robot's"
            )
    names = [_transmitter_name(path) for path in tx]
    if len(set(names)) < len(names):
        raise RecordingError(f"two files of one transmitter: {', '.join(path.name for path in tx)}")
    stamp = _STAMP.search(rx.name)
    return Run(
        stamp=stamp.group() if stamp else rx.stem,
        folder=rx.parent,
        rx=rx,
        tx=dict(zip(names, tx, strict=True)),
        trajectories={kind or guess_kind(trajectory): trajectory},
        truth=_truth_near(rx.parent),
        loose=True,
    )


def read_truth(path: Path) -> Survey:
    """Channel and true positions. Raises RecordingError that names the file and the line or the key."""
    content = _json_of(path)
    try:
        channel = _whole(_at(content, "channel", "value"))
        channel_frequency_hz(channel)
        places = _at(content, "true_tx_positions", "value")
        positions = {
            name: np.array([_number(place, name, "position", axis) for axis in "xyz"])
            for name, place in ((name, {name: entry}) for name, entry in _mapping(places, "value").items())
        }
    except (ValueError, OverflowError) as error:
        raise RecordingError(f"{path}: {error}; {_EXPECTED_TRUTH}") from None
    for name, p in positions.items():
        if not np.all(np.abs(p) <= MAX_POSITION_M):
            raise RecordingError(
                f"{path}: position of {name} is {p.tolist()}; expected metres within 1e5 of the origin"
            )
    return Survey(path, channel, {name: p for name, p in positions.items() if np.any(p != 0)})


def _json_of(path: Path) -> object:
    """Raises RecordingError; also for a key that stands twice, of which JSON would take the last."""
    try:
        with open_regular(path) as file:
            data = file.read(_MAX_TRUTH_BYTES + 1)
        if len(data) > _MAX_TRUTH_BYTES:
            raise RecordingError(f"{path}: larger than 10 MB, expected a few true positions")
        return json.loads(data.decode("utf-8-sig"), object_pairs_hook=_once)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise RecordingError(f"{path}: not UTF-8; expected a JSON file of true positions") from None
    except json.JSONDecodeError as error:
        why = f"line {error.lineno}: {error.msg}"
        raise RecordingError(f"{path}: not a JSON file of true positions: {why}") from None
    except (ValueError, RecursionError) as error:
        why = "nested too deep" if isinstance(error, RecursionError) else str(error)
        raise RecordingError(f"{path}: not a JSON file of true positions: {why}") from None


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    values: dict[str, object] = {}
    for name, value in pairs:
        if name in values:
            raise ValueError(f"{name} is there twice; keep one of them")
        values[name] = value
    return values


def _mapping(value: object, name: str) -> dict[str, object]:
    if not isinstance(value, dict):
        raise ValueError(f"{name} holds {json.dumps(value)[:40]}, no keys")
    return value


def _at(content: object, *keys: str) -> object:
    """Raises ValueError naming the key that is not there."""
    name = "it"
    for key in keys:
        inside = _mapping(content, name)
        if key not in inside:
            raise ValueError(f"key {key!r} is missing")
        content, name = inside[key], key
    return content


def _number(content: object, *keys: str) -> float:
    value = _at(content, *keys)
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"{'.'.join(keys)} is {json.dumps(value)[:40]}, no number")
    return float(value)


def _whole(value: object) -> int:
    number = _number({"channel.value": value}, "channel.value")
    if not number.is_integer():
        raise ValueError(f"channel.value is {value}, not a whole number")
    return int(number)


def _folders(root: Path) -> Iterator[Path]:
    """`root` and all below it, each real folder once however many links lead there: by its own name if it has one.
    Raises RecordingError for so many that a link leads out of any data set."""
    waiting, seen = deque([root]), set[Path]()
    while waiting:
        for name, below, _ in os.walk(waiting.popleft()):  # which goes into no link but the one it is given
            folder = Path(name)
            if folder.resolve() in seen:
                below.clear()
                continue
            seen.add(folder.resolve())
            if len(seen) > _MOST_FOLDERS:
                raise RecordingError(f"{root}: more than {_MOST_FOLDERS} folders below; name that of the recordings")
            waiting += sorted(folder / link for link in below if (folder / link).is_symlink())
            yield folder


def _runs_of(folder: Path) -> list[Run]:
    files: dict[str, dict[str, Path]] = {}
    for path in sorted([*folder.glob("csi_*.dat"), *folder.glob("csi_*.csi")]):
        match = _CSI_NAME.fullmatch(path.name)
        if match:
            there = files.setdefault(match[2], {}).setdefault(match[1], path)
            if there != path:
                raise RecordingError(f"{there} and {path.name}: which is the run's? Move one of them away")
    runs = []
    for stamp, ends in sorted(files.items()):
        fitting = _trajectories(folder, stamp, files.keys() - {stamp})
        runs.append(
            Run(
                stamp=stamp,
                folder=folder,
                rx=ends.get("rx"),
                tx={name: path for name, path in ends.items() if name != "rx"},
                trajectories={kind: paths[0] for kind, paths in fitting.items() if len(paths) == 1},
                ambiguous={kind: tuple(paths) for kind, paths in fitting.items() if len(paths) > 1},
                truth=_truth_near(folder),
            )
        )
    return runs


def _trajectories(folder: Path, stamp: str, others: Set[str]) -> dict[PoseKind, list[Path]]:
    """What fits, by kind: in the folder itself, else above it, else in a folder beside it. There the one that has the
    exact name, else all that have the stamp in theirs and are not exactly another run's."""
    found: dict[PoseKind, list[Path]] = {}
    for places in ([folder], *_around(folder)):
        fitting = [path for place in places for path in sorted(place.glob("*rx_trajectory*")) if _fits(path, stamp)]
        for kind in {guess_kind(path) for path in fitting} - found.keys():
            of_kind = [path for path in fitting if guess_kind(path) is kind]
            exact = [path for path in of_kind if _is_exact(path, stamp)]
            loose = [path for path in of_kind if not any(_is_exact(path, other) for other in others)]
            if exact or loose:
                found[kind] = exact or loose
    return found


def _around(folder: Path) -> Iterator[list[Path]]:
    """The folder above, then those beside it: where it was found, and where it really is if that is elsewhere."""
    real = folder.resolve()
    for parent in [folder.parent] + [real.parent] * (real.parent != folder.parent.resolve()):
        yield [parent]
        try:
            yield sorted(path for path in parent.iterdir() if path != folder and _is_folder(path))
        except OSError:
            continue  # a folder that may not be listed holds nothing for us


def _fits(path: Path, stamp: str) -> bool:
    """Whether the stamp stands in the name whole: not as the beginning of a longer one."""
    pattern = rf".*rx_trajectory.*{re.escape(stamp)}(?![0-9A-Za-z]).*"
    return path.suffix.lower() in _TRAJECTORY_SUFFIXES and re.fullmatch(pattern, path.name, re.DOTALL) is not None


def _is_exact(path: Path, stamp: str) -> bool:
    return re.fullmatch(rf"(t265_|odom_|mocap_)?rx_trajectory_?{re.escape(stamp)}_?", path.stem) is not None


def _is_folder(path: Path) -> bool:
    try:
        return os.access(path, os.R_OK | os.X_OK) and path.is_dir()
    except OSError:
        return False


def _truth_near(folder: Path) -> Path | None:
    for place in (folder, folder.resolve().parent, folder.parent):
        try:
            if (place / TRUTH_NAME).is_file():
                return place / TRUTH_NAME
        except OSError:
            continue  # what may not be looked at is not there for us
    return None


def _is_receivers(path: Path) -> bool:
    return _RECEIVER.search(path.name) is not None and _TRANSMITTER.search(path.name) is None


def _is_transmitters(path: Path) -> bool:
    return _TRANSMITTER.search(path.name) is not None and _RECEIVER.search(path.name) is None


def _transmitter_name(path: Path) -> str:
    match = _TRANSMITTER.search(path.name)
    return match.group() if match else path.stem
