"""The cases of recordings found in use, each as its README wants it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.analyze_command import Cli, links, one_line
from tests.paths import FIELD_CASES, ROOT

pytestmark = pytest.mark.skipif(not FIELD_CASES.is_dir(), reason="no field cases beside this clone")
_RIGHT_DEG = (75.9, 76.4)


def _bearing(cli: Cli, folder: Path, result: Path) -> tuple[float, float]:
    ended = cli(folder, "--no-pictures", "--json", result)
    assert ended.code == 0, ended.err
    (link,) = links(result).values()
    return link["azimuth_deg"], link["polar_deg"]


@pytest.mark.parametrize("case", ["traj-8-columns-bagpy", "tum-blanks"])
def test_a_trajectory_of_another_tool_gives_the_right_bearing(cli: Cli, tmp_path: Path, case: str) -> None:
    assert _bearing(cli, FIELD_CASES / case / "run", tmp_path / "r.json") == pytest.approx(_RIGHT_DEG, abs=0.2)


def test_a_truth_with_a_byte_order_mark_is_read(cli: Cli, tmp_path: Path) -> None:
    truth = FIELD_CASES / "truth-bom" / "groundtruth_positions.json"
    assert truth.read_bytes()[:3] == b"\xef\xbb\xbf"
    shutil.copytree(FIELD_CASES / "tum-blanks" / "run", tmp_path / "run")
    shutil.copy(truth, tmp_path / "run")
    assert _bearing(cli, tmp_path / "run", tmp_path / "r.json") == pytest.approx(_RIGHT_DEG, abs=0.2)


def test_a_motive_export_is_called_one_and_what_it_needs_is_said(cli: Cli) -> None:
    ended = cli(FIELD_CASES / "motive-csv-export" / "run", "--no-pictures")
    assert ended.code == 1 and one_line(ended)
    assert "read as an OptiTrack Motive export" in ended.err and "--time-offset puts them there" in ended.err


def test_every_case_is_named_in_a_test() -> None:
    texts = [path.read_text() for path in (ROOT / "tests").rglob("test_*.py")]
    patterns = ("mcap-", "yaml-")
    for folder in FIELD_CASES.iterdir():
        assert folder.name.startswith(patterns) or any(folder.name in text for text in texts), folder.name
