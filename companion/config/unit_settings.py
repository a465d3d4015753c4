"""What a configuration needs of its unit beside what every one has: no capability is wider than what is asked for.

`companion-setup configure` writes it as a drop-in of systemd, and `companion doctor system` compares.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Final

from companion.config.schema import Config

_HEAD: Final = "# Written by companion-setup for /etc/companion/companion.yaml; changes here are lost.\n"
_HOMES: Final = ("/home", "/root")


def drop_in(config: Config) -> str:
    """Text of a drop-in; of comments alone where the unit suffices."""
    lines = list(_lines(config))
    return _HEAD + ("[Service]\n" + "\n".join(lines) + "\n" if lines else "# It needs nothing beside its unit.\n")


def unit_of(config: Config) -> str:
    """The unit that runs a robot of this role."""
    return "companion.service" if config.role == "uav" else "companion-beacon.service"


def _lines(config: Config) -> Iterator[str]:
    if config.ping.enabled:
        yield "# ping.enabled: raw frames on the card's interface."
        yield "AmbientCapabilities=CAP_NET_RAW"
        yield "CapabilityBoundingSet=CAP_NET_RAW"
        yield "RestrictAddressFamilies=AF_PACKET"
    if config.pose.source == "socket" and config.pose.reader_command:
        yield "# pose.reader_command: a camera's reader of the service's own."
        yield "SupplementaryGroups=plugdev"
        if config.role == "beacon":
            yield "PrivateDevices=no"
        yield "DeviceAllow=char-usb_device rw"
    if config.tag_camera.enabled:
        yield "# tag_camera.enabled: the camera that sees tags."
        yield "SupplementaryGroups=video"
        yield "DeviceAllow=char-video4linux rw"
    for key, path in (("recorder.path", config.recorder.path), ("state_dir", config.state_dir)):
        folder = str(config.path(path).parent if key == "recorder.path" else config.path(path))
        if not _is_given(folder):
            yield f"# {key}: a folder of its own."
            yield f"ReadWritePaths={folder}"
            if folder.startswith(_HOMES):
                yield "ProtectHome=no"


def _is_given(folder: str) -> bool:
    given = ("/var/lib/companion", "/var/log/companion", "/run/companion", "/var/cache/companion")
    return any(PurePosixPath(folder).is_relative_to(one) for one in given)
