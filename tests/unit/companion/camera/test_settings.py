"""What the process is told of a configuration."""

from __future__ import annotations

from dataclasses import replace

from companion.camera.settings import reader_settings, settings_of
from companion.config.file import load_config
from companion.config.tag_camera import PeerTag, TagCameraConfig
from tests.paths import CONFIGS


def test_it_is_told_what_stands_in_the_configuration() -> None:
    camera = TagCameraConfig(enabled=True, source="images", tags=[PeerTag(peer=2, tag=7, size_m=0.2)], rate_hz=5.0)
    config = replace(load_config(CONFIGS / "uav.yaml"), tag_camera=camera)
    told = settings_of(reader_settings(config))
    assert (told.source, told.sizes_m, told.rate_hz) == ("/run/companion/images", {7: 0.2}, 5.0)
    assert (told.size_px, told.focal_px, told.centre_px) == ((640, 480), (600.0, 600.0), (320.0, 240.0))
    numbered = replace(config, tag_camera=replace(camera, source="2"))
    assert settings_of(reader_settings(numbered)).source == "2", "a camera's number is no path"
