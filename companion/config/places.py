"""Checks of what a configuration says of places: paths on this host, and where the antenna is on the robot."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from companion.config.schema import Config

LONGEST_LEVER_M: Final = 2.0
_VARIABLE: Final = re.compile(r"\$\{?[A-Za-z_]")


def path_errors(config: Config) -> Iterator[str]:
    """Paths that cannot mean what was meant."""
    for key, path in _paths(config):
        if path.startswith("~"):
            yield f"{key}: {path}: ~ is not expanded, the service runs as another user; expected an absolute path"
        elif _VARIABLE.search(path):
            yield f"{key}: {path}: variables such as $HOME are not put in; expected an absolute path"
        elif not path or "\0" in path:
            yield f"{key}: {path!r}; expected a path"
    if config.recorder.path.endswith(("/", "/.", "/..")):
        yield f"recorder.path: {config.recorder.path}: a folder; expected a file, for example log.mcap"


def lever_errors(config: Config) -> Iterator[str]:
    """A lever arm that no robot has: it would be centimetres, or another axis."""
    for axis, length_m in zip(("forward", "left", "up"), config.pose.antenna_m, strict=True):
        if abs(length_m) > LONGEST_LEVER_M:
            yield (
                f"pose.antenna_m: {length_m:g} m {axis}; expected within {LONGEST_LEVER_M:g} m of the tracker, in "
                "metres: a degree of attitude moves an antenna further out by more than half a wavelength"
            )


def _paths(config: Config) -> Iterator[tuple[str, str]]:
    yield "runtime_dir", config.runtime_dir
    yield "state_dir", config.state_dir
    yield "control_socket", config.control_socket
    yield "status_socket", config.status_socket
    yield "csi.socket", config.csi.socket
    yield "pose.socket", config.pose.socket
    yield "recorder.path", config.recorder.path
    yield "neighbours.key_file", config.neighbours.key_file
    if config.pose.source == "recording" and config.pose.recording:
        yield "pose.recording", config.pose.recording
    if config.autopilot is not None and config.autopilot.signing_key_file is not None:
        yield "autopilot.signing_key_file", config.autopilot.signing_key_file
    if config.foxglove.token_file is not None:
        yield "foxglove.token_file", config.foxglove.token_file
    if config.page.token_file is not None:
        yield "page.token_file", config.page.token_file
    for key in ("ca_file", "cert_file", "key_file"):
        path = getattr(config.tak, key)
        if path is not None:
            yield f"tak.{key}", path
    for index, peer in enumerate(config.peers):
        yield f"peers[{index}].key_file", peer.key_file
        if peer.next_key_file is not None:
            yield f"peers[{index}].next_key_file", peer.next_key_file
