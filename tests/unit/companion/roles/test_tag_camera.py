"""The tag camera's process as a real one: started where it is configured, and replaced when it is killed."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.camera.sighting import TagFrame
from companion.config.file import load_config
from companion.config.schema import Config
from companion.config.tag_camera import PeerTag, TagCameraConfig
from companion.errors import ConfigError
from companion.host import fed_process
from companion.roles import tag_camera
from companion.roles.tag_camera import READER, TagCamera
from tests.paths import CONFIGS
from tests.unit.companion.roles.test_page import children

_PATIENCE_S = 60.0


def _config(enabled: bool, source: Path) -> Config:
    camera = TagCameraConfig(
        enabled=enabled, source=str(source), tags=[PeerTag(peer=2, tag=7, size_m=0.16)], rate_hz=20.0
    )
    return replace(load_config(CONFIGS / "demo-uav.yaml"), tag_camera=camera)


async def _until(holds: Callable[[], object]) -> None:
    async with asyncio.timeout(_PATIENCE_S):
        while not holds():  # noqa: ASYNC110 - a process answers when it does
            await asyncio.sleep(0.02)


async def test_a_process_that_is_killed_is_replaced_and_nothing_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cv2 = pytest.importorskip("cv2", reason="needs the extra apriltag")
    from benchmarks.tag_images import View, tag_image

    monkeypatch.setattr(fed_process, "_FIRST_WAIT_S", 0.05)
    image = tag_image(View(distance_m=1.5, tilt_rad=0.4), 7, np.random.default_rng(1))
    for number in range(100):
        cv2.imwrite(str(tmp_path / f"{number}.png"), image)
    taken: list[TagFrame] = []
    camera = TagCamera(_config(True, tmp_path), taken.append)
    camera.start()
    try:
        await _until(lambda: taken)
        assert [tag.id for tag in taken[0].tags] == [7]
        (pid,) = children(READER)
        os.kill(pid, signal.SIGKILL)
        await _until(lambda: children(READER) not in ([], [pid]))
        known = len(taken)
        await _until(lambda: len(taken) > known)
    finally:
        await camera.aclose()
    assert children(READER) == []


def test_without_the_library_it_is_refused_at_the_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tag_camera, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"tag_camera\.enabled: needs the library .*wsr-companion\[apriltag\]"):
        TagCamera(_config(True, tmp_path), lambda frame: None)
    TagCamera(_config(False, tmp_path), lambda frame: None)


async def test_off_it_starts_nothing(tmp_path: Path) -> None:
    camera = TagCamera(_config(False, tmp_path), lambda frame: None)
    camera.start()
    await asyncio.sleep(0)
    assert children(READER) == [] and camera._source is None
    await camera.aclose()
