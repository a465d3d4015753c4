"""The keys of a configuration with their types, limits and defaults; what must fit each other is in `rules`.

Every number has a least and a largest value: what no vehicle, card or disk can mean is a slip of the pen, and a silence
without end would be a check that is not there. Angles are in degrees here and nowhere deeper. Relative paths are taken
from `runtime_dir`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from companion.config.addresses import Ipv4, Mac
from companion.config.tag_camera import TagCameraConfig
from wsr.channel import channel_frequency_hz

CHECK = "check"
"""Key of `Meta.extra`: a function that raises ValueError for a value the type permits and the field does not."""
WifiChannel = Annotated[int, Meta(extra={CHECK: channel_frequency_hz})]
Fraction = Annotated[float, Meta(ge=0, le=1)]
RobotId = Annotated[int, Meta(ge=1, le=65535)]
Latitude = Annotated[float, Meta(ge=-90, le=90)]
Longitude = Annotated[float, Meta(ge=-180, le=180)]
Metres = Annotated[float, Meta(ge=-10000, le=10000)]
Metres3 = tuple[Metres, Metres, Metres]


@dataclass(frozen=True, slots=True)
class CsiConfig:
    """The radio card. `netlink` reads the Intel 5300's driver; `nl80211` that of an AX200 or AX210 (FeitCSI; hardware
    unverified); `unix` reads the same bytes of either from a datagram socket."""

    channel: WifiChannel
    """WiFi channel in the 5 GHz band (`wsr.channel.CHANNELS_5GHZ`); sets the wavelength."""
    source: Literal["netlink", "nl80211", "unix"] = "netlink"
    connector_idx: Annotated[int, Meta(ge=1, le=32)] = 26
    """Netlink connector index of the driver: 26 on Linux 4.15, 25 on older kernels. With `nl80211` only the number by
    which `companion feed` finds the service."""
    require_kernel_sender: bool = True
    """Refuse records that another process sent. Only a simulation turns this off."""
    socket: str = "csi.sock"
    interface: str | None = None
    """The card's monitor interface, for example mon0: pings are sent there, `doctor radio` looks at it, and `nl80211`
    asks for its reports."""
    receive_buffer_bytes: Annotated[int, Meta(ge=65536, le=1 << 30)] = 4 << 20
    width_mhz: Literal[20, 40, 80, 160] = 20
    """Of the band with `channel` in it that an AX card is set to, and what it sends. An Intel 5300's: 20."""


@dataclass(frozen=True, slots=True)
class NatNetConfig:
    """An OptiTrack server that streams to this host (unicast)."""

    server: str = "127.0.0.1"
    port: Annotated[int, Meta(ge=1, le=65535)] = 1510
    """Its command port."""
    body: Annotated[int, Meta(ge=0, le=2**31 - 1)] = 1
    """Streaming id of this robot's rigid body."""
    up: Literal["y", "z"] = "y"
    """Motive's up axis as it streams."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseConfig:
    """Where poses come from."""

    source: Literal["socket", "px4", "natnet", "recording"] = "socket"
    """`socket`: datagrams of a camera's reader; `px4`: the autopilot's odometry; `natnet`: OptiTrack; `recording`."""
    socket: str = "pose.sock"
    reader_command: list[str] = field(default_factory=list)
    """Program and arguments of the camera's reader, which the service starts and restarts; empty where systemd does."""
    recording: str = ""
    """Trajectory of `source: recording`, z up, in any format of docs/recordings.md: TUM, CSV, a rosbag2."""
    natnet: NatNetConfig = field(default_factory=NatNetConfig)
    north: Literal["config", "autopilot"] = "config"
    """Who knows where North is: north_yaw_deg, or the autopilot's heading over a still period before the flight."""
    north_yaw_deg: Annotated[float, Meta(ge=-360, le=360)] = 0.0
    """Turn, counter-clockwise, from the tracker's start heading axis (its East) to true East."""
    antenna_m: Metres3 = (0.0, 0.0, 0.0)
    """The receiving antenna in body axes (forward, left, up), from the tracker."""
    stale_s: Annotated[float, Meta(ge=0.01, le=2)] = 0.2
    """An aperture with a longer gap is dropped, the vehicle holds, and nothing engages."""
    min_confidence: Annotated[int, Meta(ge=1, le=3)] = 2
    """An aperture with poses below this tracker confidence (T265: 1 low, 2 medium, 3 high) is dropped."""
    min_rate_hz: Annotated[float, Meta(ge=1, le=1000)] = 20.0
    drift: Annotated[float, Meta(ge=0, le=0.5)] | None = None
    """Share of the way by which poses drift off along each axis; when absent 0.025, a T265's, or 0.002 of `natnet`."""
    lost_s: Annotated[float, Meta(ge=0.05, le=60)] | None = None
    """After so long without poses the vehicle lands; when absent 8 with GPS, 3 without. A T265 needs up to 7 s to come
    back by itself; without GPS PX4 flies on for no more than 4.6 s, and then lands blind."""


@dataclass(frozen=True, slots=True)
class Peer:
    """A robot we may hear. Its key signs its datagrams; its MAC marks its frames."""

    id: RobotId
    name: Annotated[str, Meta(min_length=1, max_length=32)]
    mac: Mac
    key_file: str
    next_key_file: str | None = None
    """Also valid, while keys are being replaced."""
    ack_length: Annotated[int, Meta(ge=40, le=1500)] = 57
    """Bytes on the air, with check sum, of the frames that this robot's driver answers; each beacon has its own."""
    antenna_height_m: Annotated[float, Meta(ge=0, le=5)] | None = None
    """Of its antenna above the floor that the vehicle takes off from: see docs/guidance.md. Not where floors differ."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NeighbourConfig:
    """UDP broadcasts between robots, over another interface than the one in monitor mode."""

    key_file: str
    """Our own key, 32 bytes or more, readable by the owner only."""
    port: Annotated[int, Meta(ge=1, le=65535)] = 17650
    broadcast: Ipv4 = "127.255.255.255"
    """The broadcast address of the robots' network, or a multicast group."""
    interface: str | None = None
    """The network interface that datagrams leave and enter by; its bytes per second are shown in health. Without it the
    kernel's routes decide; a multicast group needs either."""
    refuse_lookalikes: bool = False
    """Let a robot whose profiles cannot be told from another's steer nothing. It is reported in any case."""
    rate_hz: Annotated[float, Meta(ge=0.1, le=50)] = 10.0
    pose_rate_hz: Annotated[float, Meta(ge=0.1, le=200)] = 50.0
    budget_bytes_s: Annotated[float, Meta(ge=2000, le=50000)] = 5000.0
    """Of our datagrams as an interface counts them; channels beyond it are left out evenly. 5000 carries 210 packets/s
    with 50 poses/s whatever the channels are, and the 250 packets/s of the recordings that have most."""


@dataclass(frozen=True, slots=True)
class PingConfig:
    """What we transmit on the card's interface. Without `csi.interface` nothing is sent."""

    enabled: bool = False
    """Role uav: ping the beacons in turn. Role beacon: answer pings from user space, where the driver does not."""
    rate_hz: Annotated[float, Meta(ge=60, le=200)] = 120.0
    """Of all pings together."""
    mcs: Annotated[int, Meta(ge=0, le=7)] = 1
    """HT rate of one stream over 20 MHz; of an AX card (`csi.source: nl80211`) VHT over csi.width_mhz."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ApertureConfig:
    """One SAR iteration."""

    estimator: Literal["robust", "music", "bartlett"] = "robust"
    length_m: Annotated[float, Meta(ge=0.1, le=20)] = 1.2
    min_packets: Annotated[int, Meta(ge=16, le=100000)] = 80
    max_pose_gap_s: Annotated[float, Meta(ge=0.005, le=1)] = 0.05
    period_s: Annotated[float, Meta(ge=0.05, le=60)] = 0.5
    """How often an estimate is made, if the worker keeps up; apertures overlap."""
    settle_s: Annotated[float, Meta(ge=0, le=10)] = 0.3
    """How long reverse channels have to arrive: an aperture ends that long ago."""
    silent_s: Annotated[float, Meta(ge=0.1, le=30)] = 2.0
    """Without packets or without datagrams of the target for so long, the vehicle holds."""
    blind_legs: Annotated[int, Meta(ge=1, le=20)] = 3
    """After so many apertures' worth of path without a bearing that may steer, the vehicle holds and tries again; after
    so many holds it waits, and is left as mission.lost_target says."""
    min_reliability: Fraction = 0.1
    """A bearing below this says little; alone it does not steer."""
    worker_timeout_s: Annotated[float, Meta(ge=0.1, le=60)] = 2.0


@dataclass(frozen=True, slots=True)
class AutopilotConfig:
    url: str
    """MAVSDK connection, for example udpin://127.0.0.1:14540 or serial:///dev/ttyS1:921600."""
    system_id: Annotated[int, Meta(ge=1, le=255)] | None = None
    """MAVLink system id of our vehicle (MAV_SYS_ID); absent for the first PX4 that is heard, and no other after it."""
    gps: bool = True
    """Whether the autopilot's position comes from GPS, else from our poses: decides which parameters are required."""
    forward_vio_hz: Annotated[float, Meta(ge=0, le=100)] = 0.0
    """How often our poses are sent to its estimator (ODOMETRY); 0 for never. Without GPS 30 or more; least 20."""
    origin_deg: tuple[Latitude, Longitude] = (47.3977, 8.5456)
    """Without GPS: about where on Earth the vehicle is (latitude, longitude); the nearest town will do. PX4 needs a
    place for its hold and return, and takes declination and strength of the magnetic field from it."""
    signing_key_file: str | None = None
    """Key of MAVLink 2 message signing, 32 bytes, readable by its owner only, where the vehicle demands it; absent for
    none. Over udpin, udpout and serial."""
    ground_hz: Annotated[float, Meta(ge=0, le=4)] = 0.0
    """How often ground stations are told bearing, range and state through the autopilot, with a sentence for each
    change of state and each refusal; 0 for never."""
    engage_rc_channel: Annotated[int, Meta(ge=1, le=18)] | None = None
    """RC channel of a switch: up engages, down aborts. The receiver's failsafe must put it down. Absent for none."""
    engage_rc_above_us: Annotated[int, Meta(ge=1000, le=2000)] = 1700
    """Pulse width above which that switch is up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionConfig:
    control: Literal["observe", "fly"] = "observe"
    """`observe` computes and logs everything and commands nothing; only `fly` can be engaged."""
    leave: Literal["hold", "land", "return"] = "hold"
    """What the autopilot is left in at the target."""
    lost_target: Literal["return", "land"] = "return"
    """What it is left in when the target stays silent, or no bearing to it is found, while the vehicle holds."""
    vehicle: Literal["copter", "rover"] = "copter"
    """A `rover` drives on the ground: nothing takes off or lands, heights are not looked at, and set points are
    velocities in the plane."""
    setpoints: Literal["position", "velocity"] = "position"
    """`velocity` sends velocities alone, led back to the path: for an autopilot whose position drifts against it."""
    yaw: Literal["fixed", "target"] = "fixed"
    """Keep the heading of the start, or turn the nose to the target."""
    takeoff_height_m: Annotated[float, Meta(ge=0.5, le=20)] = 1.5
    """From near it is left for one from which a target far below or above can be arrived at."""
    speed_m_s: Annotated[float, Meta(ge=0.02, le=2)] = 0.5
    acceleration_m_s2: Annotated[float, Meta(ge=0.05, le=10)] = 0.8
    lateral_weave_m: Annotated[float, Meta(ge=0, le=5)] = 0.12
    vertical_weave_m: Annotated[float, Meta(ge=0, le=5)] = 0.1
    target: RobotId | None = None
    """Id of the peer to fly to; the first of `peers` when absent."""
    min_battery: Annotated[
        float,
        Meta(ge=0.05, le=1, description="a share of charge of 0.05 to 1, for example 0.2; less would turn it off"),
    ] = 0.2
    """Below this share of charge the vehicle lands."""
    limit_s: Annotated[float, Meta(ge=1, le=86400)] = 900.0
    """Longest approach without a hold, after which the vehicle lands."""
    hold_limit_s: Annotated[float, Meta(ge=1, le=3600)] = 60.0
    """After holding for so long without the target the vehicle is left as lost_target says."""
    arrival_range_m: Annotated[float, Meta(ge=0.1, le=100)] = 2.0
    """The mission has arrived when the target is within this range,"""
    arrival_confidence: Annotated[float, Meta(ge=0.5, lt=1)] = 0.9
    """with this probability, over a whole aperture of new packets."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GateConfig:
    """Limits of the set point gate, in the autopilot's local frame (East, North, Up from its origin)."""

    fence_min_m: Metres3 = (-50.0, -50.0, -1.0)
    fence_max_m: Metres3 = (50.0, 50.0, 10.0)
    fence_yaw_deg: Annotated[float, Meta(ge=-360, le=360)] = 0.0
    """By which the box is turned about the origin, counter-clockwise from East: fence_min_m and fence_max_m are along
    its own axes, as the walls of a building are. Heights and the cylinder do not turn."""
    fence_radius_m: Annotated[float, Meta(ge=0.5, le=10000)] = 60.0
    max_speed_m_s: Annotated[float, Meta(ge=0.05, le=20)] = 1.0
    max_climb_m_s: Annotated[float, Meta(ge=0.05, le=10)] = 0.7
    max_acceleration_m_s2: Annotated[float, Meta(ge=0.05, le=20)] = 3.0
    min_height_m: Annotated[float, Meta(ge=-100, le=100)] = 0.5
    max_age_s: Annotated[float, Meta(ge=0.02, le=1)] = 0.2
    min_neighbour_m: Annotated[float, Meta(ge=0.01, le=100)] = 1.0
    """Least distance of a set point from where another robot is known to be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderConfig:
    """The flight's log; see docs/log.md."""

    path: str = "log.mcap"
    queue_messages: Annotated[int, Meta(ge=100, le=1000000)] = 20000
    """Messages that wait for the disk; more are dropped and counted."""
    compression: Literal["zstd", "lz4"] = "zstd"
    chunk_kb: Annotated[int, Meta(ge=64, le=256)] = 64
    """A chunk ends at this size before compression, or after 0.85 s."""
    rotate_mb: Annotated[float, Meta(ge=2, le=1000000)] = 256.0
    """A file is finished and the next begun before it exceeds this size."""
    rotate_s: Annotated[float, Meta(ge=0.1, le=604800)] = 1800.0
    """So is one of this age."""
    budget_mb: Annotated[float, Meta(ge=2, le=100000000)] = 4096.0
    """All files of the recording together; the oldest finished ones go first."""
    min_free_mib: Annotated[float, Meta(ge=0, le=10000000)] = 500.0
    """Nothing engages with less space left on the log's disk."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamConfig:
    """Where all robots are relative to this one, by everybody's bearings, by a process of its own; see docs/team.md."""

    enabled: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class TakConfig:
    """Cursor on Target events for TAK, by a process of its own; see docs/tak.md. Needs a vehicle with GPS."""

    enabled: bool = False
    transport: Literal["udp", "tls"] = "udp"
    address: Annotated[str, Meta(min_length=1, max_length=253)] = "239.2.3.1"
    """Of `udp` a multicast group, by default that of TAK's mesh, or one host; of `tls` the name of a TAK server, as its
    certificate has it."""
    port: Annotated[int, Meta(ge=1, le=65535)] = 6969
    """A TAK server's TLS port is 8089 as a rule."""
    ttl: Annotated[int, Meta(ge=0, le=255)] = 1
    """Networks that a multicast may pass."""
    interface: Ipv4 | None = None
    """Address of ours that multicasts leave by; absent where the kernel's routes decide."""
    ca_file: str | None = None
    """Of `tls`: who signed the server's certificate (PEM),"""
    cert_file: str | None = None
    """our own certificate,"""
    key_file: str | None = None
    """and its key, readable by its owner only."""
    callsign: Annotated[str, Meta(min_length=1, max_length=32)] | None = None
    """What the vehicle is called there; absent for `name`."""
    period_s: Annotated[float, Meta(ge=0.2, le=60)] = 1.0
    stale_s: Annotated[float, Meta(ge=1, le=3600)] = 10.0
    """After so long TAK takes what it was told for old."""
    wedge_m: Annotated[float, Meta(ge=1, le=10000)] = 50.0
    """How long a bearing's wedge is drawn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageConfig:
    """What a browser is shown of the robot, by a process of its own; see docs/page.md."""

    enabled: bool = False
    address: Ipv4 = "127.0.0.1"
    """Where it listens: on this host alone, or at an interface's address (0.0.0.0 for all), which needs a token."""
    port: Annotated[int, Meta(ge=1, le=65535)] = 8970
    token_file: str | None = None
    """File of a secret word, readable by its owner only; whoever looks must know it. Absent on loopback for none."""
    allow_engage: bool = False
    """Whether who knows the token may engage and abort from the page."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoxgloveConfig:
    """The streams of the log live to Foxglove's viewers, by a process of its own; see docs/foxglove.md."""

    enabled: bool = False
    """Whether there is a server; needs the extra `foxglove`."""
    address: Ipv4 = "127.0.0.1"
    """Where it listens: on this host alone, or at an interface's address (0.0.0.0 for all), which needs a token."""
    port: Annotated[int, Meta(ge=1, le=65535)] = 8765
    token_file: str | None = None
    """File of a secret word, readable by its owner only; whoever looks must know it. Absent on loopback for none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Config:
    """Everything the service reads. A role `uav` also needs `autopilot`."""

    role: Literal["uav", "beacon"]
    id: RobotId
    name: Annotated[str, Meta(min_length=1, max_length=32)]
    csi: CsiConfig
    neighbours: NeighbourConfig
    peers: list[Peer]
    runtime_dir: str = "/run/companion"
    state_dir: str = "/var/lib/companion"
    """What must outlive a restart: the numbers that make replayed datagrams show."""
    ack_length: Annotated[int, Meta(ge=40, le=1500)] = 57
    """Role beacon: bytes on the air, with check sum, of the frames that are for us."""
    control_socket: str = "control.sock"
    status_socket: str = "status.sock"
    """Where members of the service's group may ask for the status, and nothing else."""
    ping: PingConfig = field(default_factory=PingConfig)
    pose: PoseConfig = field(default_factory=PoseConfig)
    recorder: RecorderConfig = field(default_factory=RecorderConfig)
    aperture: ApertureConfig = field(default_factory=ApertureConfig)
    mission: MissionConfig = field(default_factory=MissionConfig)
    gate: GateConfig = field(default_factory=GateConfig)
    page: PageConfig = field(default_factory=PageConfig)
    team: TeamConfig = field(default_factory=TeamConfig)
    tak: TakConfig = field(default_factory=TakConfig)
    foxglove: FoxgloveConfig = field(default_factory=FoxgloveConfig)
    tag_camera: TagCameraConfig = field(default_factory=TagCameraConfig)
    autopilot: AutopilotConfig | None = None

    @property
    def flies_by_poses(self) -> bool:
        """Whether our poses are all that the autopilot's position is made of."""
        return self.autopilot is not None and not self.autopilot.gps

    @property
    def pose_drift(self) -> float:
        """As `pose.drift` says, or what its source is known for."""
        if self.pose.drift is not None:
            return self.pose.drift
        return 0.002 if self.pose.source == "natnet" else 0.025

    @property
    def pose_lost_s(self) -> float:
        """After so long without poses the vehicle lands."""
        if self.pose.lost_s is not None:
            return self.pose.lost_s
        return 3.0 if self.flies_by_poses else 8.0

    @property
    def target(self) -> int:
        """Id of the peer to fly to."""
        return self.peers[0].id if self.mission.target is None else self.mission.target

    def path(self, name: str) -> Path:
        """`name` under `runtime_dir` unless it is absolute."""
        return Path(self.runtime_dir) / name
