"""What the types of a configuration cannot say: keys that must fit each other. One function for each part of the file.

Each yields what is wrong in one line that names the key and what would be right.
"""

from __future__ import annotations

import math
import os.path
import re
from collections.abc import Callable, Iterator
from typing import Final

from companion.config.addresses import IPV4
from companion.config.motions import MIN_VIO_HZ, range_errors, rate_errors, speed_errors
from companion.config.places import lever_errors, path_errors
from companion.config.schema import Config
from wsr.channel import WIDTHS_MHZ, wide_channel

_PORT = r"(6553[0-5]|655[0-2]\d|65[0-4]\d\d|6[0-4]\d{3}|[1-5]\d{4}|[1-9]\d{0,3})"
_URL: Final = re.compile(rf"(udpin|udpout|tcpin|tcpout)://[^:/\s]+:{_PORT}|serial://[^:\s]+:[1-9]\d{{2,7}}")
_BOUND_NAME: Final = re.compile(rf"(udpin|tcpin)://((?![\d.]+:)[^:/]+):{_PORT}")
_NUMBERS: Final = re.compile(r"\w+://([\d.]+):\d+")
_IPV4: Final = re.compile(IPV4)
_POSES_PER_DATAGRAM: Final = 25
_TAGS: Final = {"tag36h11": 587, "tag25h9": 35}
"""Codes of a family."""
_MAX_LOST_S: Final = 4.0
"""PX4 takes its position for valid 4.6 s after the newest pose; the landing must have begun by then."""


def config_errors(config: Config) -> list[str]:
    """Every error of a configuration whose values have the right types, each with its key."""
    return [error for rule in _RULES for error in rule(config)]


def _role(config: Config) -> Iterator[str]:
    if config.role == "uav" and config.autopilot is None:
        yield "autopilot: missing; role uav needs autopilot.url, for example udpin://127.0.0.1:14540"


def _pose(config: Config) -> Iterator[str]:
    if config.pose.source == "recording" and not config.pose.recording:
        yield "pose.recording: missing; source recording needs the path of a trajectory"
    server = config.pose.natnet.server
    if config.pose.source == "natnet" and (":" in server or not _is_host(server)):
        yield f"pose.natnet.server: {server!r}; expected an IPv4 address or a name, for example 192.168.1.10"
    for key, value, of_autopilot in (
        ("source", config.pose.source, "px4"),
        ("north", config.pose.north, "autopilot"),
    ):
        if config.autopilot is None and value == of_autopilot:
            yield f"pose.{key}: {value} needs an autopilot; expected another value"
    if config.pose.source == "px4" and config.autopilot is not None and config.autopilot.forward_vio_hz:
        yield "autopilot.forward_vio_hz: the autopilot's own odometry must not be fed back to it; expected 0"


def _peers(config: Config) -> Iterator[str]:
    if not config.peers:
        yield "peers: empty; expected at least one robot to hear"
    for key in ("id", "name", "mac"):
        values = [str(getattr(peer, key)).upper() for peer in config.peers]
        for value in sorted(set(values)):
            if values.count(value) > 1:
                yield f"peers: {key} {value} stands twice; each peer has its own"


def _names(config: Config) -> Iterator[str]:
    """A name begins topics and names of files, and is printed."""
    named = {"name": config.name} | {f"peers[{index}].name": peer.name for index, peer in enumerate(config.peers)}
    for key, name in named.items():
        if not name.isprintable() or "/" in name or not name.strip():
            yield f"{key}: {name!r}; expected letters that can be printed, no /"


def _macs(config: Config) -> Iterator[str]:
    for index, peer in enumerate(config.peers):
        first = int(peer.mac[:2], 16)
        if first & 1 or not peer.mac.strip("0:"):
            yield f"peers[{index}].mac: {peer.mac} is of no one card; expected the address that its packets come from"


def _network(config: Config) -> Iterator[str]:
    if config.neighbours.broadcast.startswith("0."):
        yield (
            f"neighbours.broadcast: {config.neighbours.broadcast} leaves no host; expected the broadcast address of "
            "the robots' network, for example 192.168.1.255"
        )


def _keys(config: Config) -> Iterator[str]:
    of_peers = (key for peer in config.peers for key in (peer.key_file, peer.next_key_file) if key)
    spelled: dict[str, list[str]] = {}
    for key in (config.neighbours.key_file, *of_peers):
        spelled.setdefault(os.path.normpath(config.path(key)), []).append(key)
    for _, keys in sorted(spelled.items()):
        if len(keys) > 1:
            yield f"key_file: {keys[0]} stands twice; each robot that sends has its own, or one could pass for another"


def _rates(config: Config) -> Iterator[str]:
    neighbours = config.neighbours
    least_hz = neighbours.pose_rate_hz / _POSES_PER_DATAGRAM
    if neighbours.rate_hz < least_hz:
        yield (
            f"neighbours.rate_hz: {neighbours.rate_hz:g}; expected at least {least_hz:g}, since a datagram "
            f"carries {_POSES_PER_DATAGRAM} poses of the {neighbours.pose_rate_hz:g} a second"
        )
    if config.ping.enabled and config.csi.interface is None:
        yield "ping.enabled: needs csi.interface, the card's monitor interface"


def _width(config: Config) -> Iterator[str]:
    csi = config.csi
    if csi.source == "netlink" and csi.width_mhz != WIDTHS_MHZ[0]:
        yield f"csi.width_mhz: {csi.width_mhz}; expected 20 of an Intel 5300 (csi.source: netlink)"
        return
    try:
        wide_channel(csi.channel, csi.width_mhz)
    except ValueError as error:
        yield f"csi.width_mhz: {error}"


def _ids(config: Config) -> Iterator[str]:
    target = config.mission.target
    if target is not None and target not in {peer.id for peer in config.peers}:
        yield f"mission.target: {target} is the id of no peer"
    for peer in config.peers:
        if peer.id == config.id:
            yield f"peers: id {peer.id} is this robot's own id"


def _fence_and_weave(config: Config) -> Iterator[str]:
    gate, mission = config.gate, config.mission
    for axis, low, high in zip("xyz", gate.fence_min_m, gate.fence_max_m, strict=True):
        if not low < high:
            yield f"gate.fence_min_m: {axis} is not below fence_max_m"
    if mission.takeoff_height_m - mission.vertical_weave_m < gate.min_height_m:
        yield "mission.takeoff_height_m: the vertical weave would reach below gate.min_height_m"
    turn_m = math.tau * math.hypot(mission.lateral_weave_m, mission.vertical_weave_m) / math.sqrt(2)
    if turn_m >= config.aperture.length_m:
        yield f"mission.lateral_weave_m: one turn takes {turn_m:.2f} m of path, more than aperture.length_m"
    if mission.takeoff_height_m + mission.vertical_weave_m > gate.fence_max_m[2]:
        yield "mission.takeoff_height_m: the vertical weave would reach above gate.fence_max_m"


def _url(config: Config) -> Iterator[str]:
    if config.autopilot is not None and (named := _BOUND_NAME.fullmatch(config.autopilot.url)):
        yield (
            f"autopilot.url: {config.autopilot.url!r}: the library binds no names such as {named[2]!r}; expected an "
            f"address of this host, for example {named[1]}://0.0.0.0:14540"
        )
    elif config.autopilot is not None and not _URL.fullmatch(config.autopilot.url):
        yield (
            f"autopilot.url: {config.autopilot.url!r}; expected udpin://HOST:PORT, udpout://HOST:PORT, "
            "tcpout://HOST:PORT or serial:///dev/NAME:BAUD, with a port of 1..65535"
        )
    elif (
        config.autopilot is not None
        and (numbers := _NUMBERS.fullmatch(config.autopilot.url))
        and not _IPV4.fullmatch(numbers[1])
    ):
        yield f"autopilot.url: {config.autopilot.url!r}: {numbers[1]} is no address; expected four numbers of 0..255"


def _recorder(config: Config) -> Iterator[str]:
    if config.recorder.rotate_mb >= config.recorder.budget_mb:
        yield "recorder.rotate_mb: one file alone would exceed recorder.budget_mb"


def _page(config: Config) -> Iterator[str]:
    page = config.page
    if page.token_file is None and not page.address.startswith("127."):
        yield f"page.token_file: missing; others than this host reach {page.address}, which needs a token"
    if page.allow_engage and page.token_file is None:
        yield "page.token_file: missing; page.allow_engage needs a token"
    if page.allow_engage and config.role != "uav":
        yield f"page.allow_engage: a {config.role} does not fly; expected false"


def _tak(config: Config) -> Iterator[str]:
    tak = config.tak
    if not tak.enabled:
        return
    if config.autopilot is None or not config.autopilot.gps:
        yield "tak.enabled: needs a vehicle that knows where on Earth it is (autopilot.gps); expected false"
    if tak.transport == "udp" and not _IPV4.fullmatch(tak.address):
        yield f"tak.address: {tak.address!r}; transport udp needs an address such as 239.2.3.1"
    if tak.transport == "tls":
        if not _is_host(tak.address):
            yield f"tak.address: {tak.address!r}; transport tls needs the server's name, as its certificate has it"
        for key in ("ca_file", "cert_file", "key_file"):
            if getattr(tak, key) is None:
                yield f"tak.{key}: missing; transport tls needs ca_file, cert_file and key_file (PEM)"


def _is_host(name: str) -> bool:
    """Whether it can be asked for at all."""
    try:
        return bool(name.strip() == name and name.encode("idna")) and "\0" not in name
    except UnicodeError:
        return False


def _foxglove(config: Config) -> Iterator[str]:
    foxglove = config.foxglove
    if foxglove.token_file is None and not foxglove.address.startswith("127."):
        yield f"foxglove.token_file: missing; others than this host reach {foxglove.address}, which needs a token"
    if foxglove.enabled and config.page.enabled and foxglove.port == config.page.port:
        yield f"foxglove.port: {foxglove.port} is the page's; expected another"


def _tag_camera(config: Config) -> Iterator[str]:
    camera = config.tag_camera
    if not camera.enabled:
        return
    if config.role != "uav":
        yield f"tag_camera.enabled: a {config.role} flies to nobody; expected false"
    if not camera.tags:
        yield "tag_camera.tags: empty; expected the tag of one robot at least, with peer, tag and size_m"
    known = {peer.id for peer in config.peers}
    for key, values in (("peer", [tag.peer for tag in camera.tags]), ("tag", [tag.tag for tag in camera.tags])):
        for value in sorted({one for one in values if values.count(one) > 1}):
            yield f"tag_camera.tags: {key} {value} stands twice; each robot has a tag of its own"
    for tag in camera.tags:
        if tag.peer not in known:
            yield f"tag_camera.tags: {tag.peer} is the id of no peer"
        if tag.tag >= _TAGS[camera.family]:
            yield f"tag_camera.tags: {camera.family} has no tag {tag.tag}; expected 0..{_TAGS[camera.family] - 1}"
    for key, place, size in (("cx_px", camera.cx_px, camera.size_px[0]), ("cy_px", camera.cy_px, camera.size_px[1])):
        if place >= size:
            yield f"tag_camera.{key}: {place:g} is outside the image of size_px; expected less than {size}"


def _autopilot(config: Config) -> Iterator[str]:
    autopilot = config.autopilot
    if autopilot is not None and not autopilot.gps and autopilot.forward_vio_hz < MIN_VIO_HZ:
        yield (
            f"autopilot.forward_vio_hz: {autopilot.forward_vio_hz:g}; expected {MIN_VIO_HZ:g} or more with "
            "autopilot.gps: false, or the estimator has no position"
        )
    if autopilot is not None and autopilot.signing_key_file is not None and autopilot.url.startswith("tcp"):
        yield "autopilot.signing_key_file: not over TCP; expected an autopilot.url with serial, udpin or udpout"
    if config.flies_by_poses and config.pose_lost_s > _MAX_LOST_S:
        yield (
            f"pose.lost_s: {config.pose_lost_s:g}; expected {_MAX_LOST_S:g} or less with autopilot.gps: false, since "
            "PX4 lands blind 4.6 s after the last pose"
        )


_RULES: Final[tuple[Callable[[Config], Iterator[str]], ...]] = (
    path_errors,
    lever_errors,
    _role,
    _pose,
    _peers,
    _names,
    _macs,
    _network,
    _keys,
    _rates,
    _width,
    _ids,
    _fence_and_weave,
    _url,
    _recorder,
    _autopilot,
    _page,
    _tak,
    _foxglove,
    _tag_camera,
    speed_errors,
    range_errors,
    rate_errors,
)
"""In the order in which errors are told."""
