"""Which source of poses a configuration means."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from companion.config.file import load_config
from companion.config.schema import Config, NatNetConfig
from companion.core.clock import MonotonicClock
from companion.core.messages import Pose
from companion.errors import CompanionError
from companion.pose.autopilot import AutopilotPoses
from companion.pose.natnet import NatNetPoses
from companion.pose.opening import open_poses
from companion.pose.recording import FilePoses
from companion.pose.source import PoseSource
from tests.paths import CONFIGS

_UAV = load_config(CONFIGS / "demo-uav.yaml")
_LEVEL = "1000,0,1.0,0.0,1.0\n1000,20000000,1.01,0.0,1.0\n"


def _config(folder: Path, **pose: Any) -> Config:
    (folder / "way.csv").write_text(_LEVEL)
    own = replace(_UAV.pose, socket=str(folder / "pose"), recording=str(folder / "way.csv"), antenna_m=(0.0, 0.0, 0.0))
    return replace(_UAV, pose=replace(own, **pose))


@pytest.mark.parametrize(
    ("pose", "kind"),
    [
        ({"source": "t265"}, PoseSource),
        ({"source": "natnet", "natnet": NatNetConfig(body=7)}, NatNetPoses),
        ({"source": "recording"}, FilePoses),
        ({"source": "px4"}, AutopilotPoses),
    ],
)
def test_each_source_is_opened_by_its_name(tmp_path: Path, pose: dict[str, Any], kind: type) -> None:
    source = open_poses(_config(tmp_path, **pose), MonotonicClock(), lambda _: None)
    assert isinstance(source, kind)
    source.close()


async def test_the_configured_north_turns_what_has_not_found_it_by_itself(tmp_path: Path) -> None:
    got: list[Pose] = []
    source = open_poses(_config(tmp_path, source="recording", north_yaw_deg=90.0), MonotonicClock(), got.append)
    await source.run()
    assert got[1].p_enu_m[1] - got[0].p_enu_m[1] == pytest.approx(0.01)
    own = open_poses(_config(tmp_path, source="px4", north_yaw_deg=90.0), MonotonicClock(), got.append)
    assert isinstance(own, AutopilotPoses)
    assert own._north_rad == 0.0


def test_an_antenna_beside_the_tracker_needs_attitudes(tmp_path: Path) -> None:
    config = _config(tmp_path, source="recording", antenna_m=(0.1, 0.0, 0.0))
    with pytest.raises(CompanionError, match=r"has no attitudes, .* pose.antenna_m .*; expected \[0, 0, 0\]"):
        open_poses(config, MonotonicClock(), lambda _: None)
