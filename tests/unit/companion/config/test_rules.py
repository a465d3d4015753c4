"""Keys that must fit each other: each rule, broken alone, is told in one line that begins with its key."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.config.file import load_config
from companion.config.rules import config_errors
from companion.config.schema import Config, NatNetConfig
from companion.config.tag_camera import PeerTag
from tests.paths import CONFIGS

UAV = load_config(CONFIGS / "demo-uav.yaml")
assert UAV.autopilot is not None
AUTOPILOT = UAV.autopilot


def changed(part: str, **values: object) -> Config:
    """The demo's flying robot with other values in one part."""
    return replace(UAV, **{part: replace(getattr(UAV, part), **values)})


def _tag(**values: int) -> PeerTag:
    return PeerTag(**{"peer": 2, "tag": 7, "size_m": 0.16} | values)  # type: ignore[arg-type]


def test_a_configuration_that_fits_has_no_errors() -> None:
    assert config_errors(UAV) == []


@pytest.mark.parametrize(
    ("config", "expected"),
    [
        (changed("pose", source="recording"), "pose.recording: missing"),
        (
            replace(changed("pose", source="px4"), autopilot=replace(AUTOPILOT, forward_vio_hz=30.0)),
            "autopilot.forward_vio_hz: the autopilot's own odometry",
        ),
        *(
            (
                changed("pose", source="natnet", natnet=NatNetConfig(server=server)),
                f"pose.natnet.server: {server!r}; expected an IPv4",
            )
            for server in ("", "::1", "h\u00f6..st", " 10.0.0.1")
        ),
        (changed("tak", enabled=True, address="tak.example.org"), "tak.address: 'tak.example.org'; transport udp"),
        (changed("tak", enabled=True, transport="tls", ca_file="a", cert_file="b"), "tak.key_file: missing"),
        (changed("tak", enabled=True, transport="tls", address="tak..org"), "tak.address: 'tak..org'; transport tls"),
        (
            replace(changed("tak", enabled=True), autopilot=replace(AUTOPILOT, gps=False, forward_vio_hz=30.0)),
            "tak.enabled: needs a vehicle that knows where on Earth",
        ),
        (changed("ping", enabled=True), "ping.enabled: needs csi.interface"),
        (changed("csi", source="netlink", width_mhz=80), "csi.width_mhz: 80; expected 20 of an Intel 5300"),
        (
            changed("csi", source="nl80211", channel=144, width_mhz=160),
            "csi.width_mhz: channel 144 is part of no band of 160 MHz",
        ),
        (changed("mission", target=99), "mission.target: 99 is the id of no peer"),
        (replace(UAV, id=UAV.peers[0].id), f"peers: id {UAV.peers[0].id} is this robot's own id"),
        (replace(UAV, peers=UAV.peers * 2), f"peers: id {UAV.peers[0].id} stands twice"),
        (changed("tag_camera", enabled=True), "tag_camera.tags: empty"),
        (changed("tag_camera", enabled=True, tags=[_tag(peer=5)]), "tag_camera.tags: 5 is the id of no peer"),
        (changed("tag_camera", enabled=True, tags=[_tag(), _tag(tag=8)]), "tag_camera.tags: peer 2 stands twice"),
        (
            changed("tag_camera", enabled=True, family="tag25h9", tags=[_tag(tag=35)]),
            "tag_camera.tags: tag25h9 has no tag 35; expected 0..34",
        ),
        (changed("tag_camera", enabled=True, cx_px=640.0, tags=[_tag()]), "tag_camera.cx_px: 640 is outside"),
        (changed("gate", min_height_m=1.45), "mission.takeoff_height_m: the vertical weave"),
        (changed("gate", fence_max_m=(50.0, 50.0, 1.55)), "mission.takeoff_height_m: the vertical weave"),
        (changed("autopilot", url="udp://:14540"), "autopilot.url: 'udp://:14540'"),
        (
            changed("autopilot", url="udpin://localhost:14540"),
            "autopilot.url: 'udpin://localhost:14540': the library binds no names such as 'localhost'; expected an "
            "address of this host, for example udpin://0.0.0.0:14540",
        ),
        *(
            (changed("autopilot", url=f"udpin://{host}:14540"), f"autopilot.url: 'udpin://{host}:14540': {host} is no")
            for host in ("300.0.0.1", "0.0.0", "010.0.0.1")
        ),
        (changed("autopilot", url="udpin://0.0.0.0:14540\n"), "autopilot.url: 'udpin://0.0.0.0:14540\\n'; expected"),
        (changed("autopilot", url="serial:///dev/ttyS1:0"), "autopilot.url: 'serial:///dev/ttyS1:0'"),
        (changed("neighbours", broadcast="0.0.0.0"), "neighbours.broadcast: 0.0.0.0 leaves no host"),
        (replace(UAV, name="a\x1b[31m"), r"name: 'a\x1b[31m'; expected letters that can be printed, no /"),
        (replace(UAV, name="\ud800"), "name: "),
        (replace(UAV, peers=[replace(UAV.peers[0], name="a/b")]), "peers[0].name: 'a/b'"),
        (replace(UAV, peers=[replace(UAV.peers[0], mac="FF:FF:FF:FF:FF:FF")]), "peers[0].mac: FF:FF:FF:FF:FF:FF is of"),
        (replace(UAV, peers=[replace(UAV.peers[0], mac="00:00:00:00:00:00")]), "peers[0].mac: 00:00:00:00:00:00 is of"),
        (
            replace(UAV, peers=[replace(UAV.peers[0], key_file=f"./x/../{UAV.neighbours.key_file}")]),
            f"key_file: {UAV.neighbours.key_file} stands twice",
        ),
        (changed("recorder", rotate_mb=5000.0), "recorder.rotate_mb"),
        (changed("autopilot", gps=False, forward_vio_hz=0.0), "autopilot.forward_vio_hz: 0; expected 20 or more"),
        (changed("page", address="0.0.0.0"), "page.token_file: missing; others than this host reach 0.0.0.0"),
        (changed("page", allow_engage=True), "page.token_file: missing; page.allow_engage needs a token"),
        (replace(changed("page", allow_engage=True), role="beacon"), "page.allow_engage: a beacon does not fly"),
        (changed("page", token_file="~/token"), "page.token_file: ~/token: ~ is not expanded"),
        (changed("pose", lost_s=4.1), "pose.lost_s: 4.1; expected 4 or less with autopilot.gps: false"),
    ],
)
def test_a_broken_rule_names_its_key(config: Config, expected: str) -> None:
    assert any(error.startswith(expected) for error in config_errors(config)), config_errors(config)


def test_without_an_autopilot_nothing_can_come_from_it() -> None:
    told = config_errors(replace(changed("pose", source="px4", north="autopilot"), autopilot=None))
    assert [error.split(":")[0] for error in told] == ["autopilot", "pose.source", "pose.north"]


def test_how_long_poses_may_be_silent_depends_on_who_else_knows_the_position() -> None:
    assert (UAV.flies_by_poses, UAV.pose_lost_s) == (True, 3.0)
    with_gps = replace(UAV, autopilot=replace(AUTOPILOT, gps=True))
    assert (with_gps.flies_by_poses, with_gps.pose_lost_s) == (False, 8.0)
    patient = replace(with_gps, pose=replace(UAV.pose, lost_s=20.0))
    assert patient.pose_lost_s == 20.0 and config_errors(patient) == []
