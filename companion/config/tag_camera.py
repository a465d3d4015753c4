"""Keys of the camera that sees tags, and what must fit each other in them; see docs/camera.md."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from msgspec import Meta

_Pixels = Annotated[float, Meta(ge=1, le=20000)]
_Degrees = Annotated[float, Meta(ge=-180, le=180)]
_Bend = Annotated[float, Meta(ge=-100, le=100)]
_Lever = Annotated[float, Meta(ge=-10, le=10)]


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerTag:
    """The tag on a robot."""

    peer: Annotated[int, Meta(ge=1, le=65535)]
    """Id of the robot that carries it, one of `peers`."""
    tag: Annotated[int, Meta(ge=0, le=586)]
    """Its number in its family."""
    size_m: Annotated[float, Meta(ge=0.01, le=5)]
    """Side of its black square, as printed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TagCameraConfig:
    """A camera that sees a tag on the robot: where it does, its place replaces the radio's bearing. By a process of its
    own; see docs/camera.md. Needs the extra `apriltag`."""

    enabled: bool = False
    source: Annotated[str, Meta(min_length=1)] = "/dev/video0"
    """A camera (V4L2), by its device or number; or a film or a folder of pictures."""
    family: Literal["tag36h11", "tag25h9"] = "tag36h11"
    tags: list[PeerTag] = field(default_factory=list)
    """One for each robot that carries one."""
    size_px: tuple[Annotated[int, Meta(ge=16, le=10000)], Annotated[int, Meta(ge=16, le=10000)]] = (640, 480)
    """Width and height of the images for which the next four hold."""
    fx_px: _Pixels = 600.0
    """Focal length across, of the calibrated camera,"""
    fy_px: _Pixels = 600.0
    """and down the image;"""
    cx_px: _Pixels = 320.0
    """the optical axis across"""
    cy_px: _Pixels = 240.0
    """and down the image."""
    distortion: tuple[_Bend, _Bend, _Bend, _Bend, _Bend] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3 of OpenCV's model."""
    position_m: tuple[_Lever, _Lever, _Lever] = (0.0, 0.0, 0.0)
    """Of the camera in body axes (forward, left, up), from the tracker."""
    yaw_deg: _Degrees = 0.0
    """By which it is turned to the left from looking along the nose,"""
    pitch_deg: _Degrees = 0.0
    """then downwards,"""
    roll_deg: _Degrees = 0.0
    """then clockwise as it looks."""
    rate_hz: Annotated[float, Meta(ge=1, le=60)] = 10.0
    """Images that are looked at in a second, at most."""
    delay_s: Annotated[float, Meta(ge=0, le=0.5)] = 0.05
    """From exposure to arrival, where the driver does not tell when an image was exposed."""
    max_range_m: Annotated[float, Meta(ge=0.2, le=100)] = 8.0
    """A tag that seems farther is not believed."""
