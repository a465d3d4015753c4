"""What the camera's process is told when it starts. Free of OpenCV: the service makes it."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from companion.config.schema import Config


@dataclass(frozen=True, slots=True, kw_only=True)
class ReaderSettings:
    """`source` is a path or the number of a camera; `sizes_m` are sides of black squares by the ids of tags."""

    source: str
    family: str
    sizes_m: dict[int, float]
    size_px: tuple[int, int]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    distortion: tuple[float, ...]
    rate_hz: float
    delay_s: float


def reader_settings(config: Config) -> str:
    """Of a configuration, as JSON."""
    camera = config.tag_camera
    source = camera.source
    settings = ReaderSettings(
        source=source if source.isdecimal() else str(config.path(source)),
        family=camera.family,
        sizes_m={tag.tag: tag.size_m for tag in camera.tags},
        size_px=camera.size_px,
        focal_px=(camera.fx_px, camera.fy_px),
        centre_px=(camera.cx_px, camera.cy_px),
        distortion=camera.distortion,
        rate_hz=camera.rate_hz,
        delay_s=camera.delay_s,
    )
    return settings_text(settings)


def settings_text(settings: ReaderSettings) -> str:
    return msgspec.json.encode(settings).decode()


def settings_of(text: str) -> ReaderSettings:
    return msgspec.json.decode(text, type=ReaderSettings)
