"""What the world simulator is told: one JSON file, checked strictly. The same scenario gives the same world."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from companion.core.messages import Vector3
from companion.errors import ConfigError
from csi_bridge.regular_file import read_regular
from wsr.channel import wide_channel

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Fraction = Annotated[float, Meta(ge=0, le=1)]
Mac = Annotated[str, Meta(pattern=r"^([0-9A-Fa-f]{2}:){5}[0-9A-Fa-f]{2}$")]
Text = Annotated[str, Meta(min_length=1)]


@dataclass(frozen=True, slots=True)
class Reflector:
    """An infinite plane of the points x with normal . x = offset_m; it reflects with gain * exp(j phase_rad)."""

    normal: Vector3
    """Of length 1."""
    offset_m: float
    gain: Fraction
    phase_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Scatterer:
    """A finite thing that scatters alike in all directions, as one of this radar cross section does."""

    p_enu_m: Vector3
    cross_section_m2: Positive
    phase_rad: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RadioScenario:
    """The radio link. Defaults are like the real captures: see the design notes on each effect."""

    card: Literal["5300", "ax210"] = "5300"
    """Of both robots; see `ax210_radio`."""
    width_mhz: Literal[20, 40, 80, 160] = 20
    """Of an ax210's packets, in the format HE."""
    channel: Annotated[int, Meta(ge=36, le=177)] = 108
    """5000 MHz + 5 MHz times this is the centre, whatever the width."""
    exchange_rate_hz: Annotated[float, Meta(ge=1, le=2000)] = 150.0
    loss_probability: Fraction = 0.05
    """Of a record, at each end independently."""
    tx_power_dbm: float = 5.0
    """Both ends, antenna gains included."""
    noise_dbm: float = -92.0
    """Thermal noise in 20 MHz with the receiver's noise figure; a wider packet has as much more of it."""
    direct_gain: Fraction = 1.0
    """Amplitude of the direct path against free space; below 1 something stands in the way."""
    shadowing_db: NotNegative = 0.0
    """Deviation of a loss that varies slowly with the places of both robots."""
    reflectors: tuple[Reflector, ...] = (
        Reflector(normal=(0.0, 0.0, 1.0), offset_m=0.0, gain=0.3, phase_rad=3.1),
        Reflector(normal=(0.0, 1.0, 0.0), offset_m=-22.0, gain=0.35, phase_rad=2.6),
    )
    reflection_order: Annotated[int, Meta(ge=1, le=2)] = 1
    """At 2 also the waves that two reflectors turn one after the other."""
    scatterers: tuple[Scatterer, ...] = ()
    turnaround_s: Positive = 300e-6
    turnaround_jitter_s: NotNegative = 5e-6
    turnaround_outlier_s: NotNegative = 130e-6
    turnaround_outlier_probability: Fraction = 0.03
    detection_delay_s: NotNegative = 200e-9
    detection_delay_std_s: NotNegative = 25e-9


def ax210_radio(radio: RadioScenario, width_mhz: Literal[20, 40, 80, 160]) -> RadioScenario:
    """The same room with AX cards: answers come from user space, a millisecond after the ping and jittered."""
    return replace(
        radio,
        card="ax210",
        width_mhz=width_mhz,
        channel=wide_channel(radio.channel, width_mhz),
        turnaround_s=1e-3,
        turnaround_jitter_s=100e-6,
        turnaround_outlier_s=1e-3,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class VioScenario:
    """Drift of the cameras. Standard deviations from which each robot's own errors are drawn; over a leg of 1.2 m they
    give the 12 mm that recorded T265 tracks are off against motion capture."""

    rate_hz: Annotated[float, Meta(ge=10, le=400)] = 200.0
    scale_std: NotNegative = 0.018
    """Constant error of the path's scale."""
    bias_std: NotNegative = 0.02
    """Slowly varying velocity error, per axis, as a share of the speed."""
    bias_correlation_s: Positive = 5.0
    walk_m_sqrt_s: NotNegative = 0.001
    """Random walk of the position, per axis, whether moving or not."""
    north_std_rad: NotNegative = 0.03
    """Constant error of the turn to true North: a tracker's start heading is known no better."""
    yaw_rate_std_rad_s: NotNegative = 0.0002
    yaw_walk_rad_sqrt_s: NotNegative = 0.001
    jitter_m: NotNegative = 0.0003
    """White noise of each position, per axis."""


@dataclass(frozen=True, slots=True)
class CsiEndpoint:
    """Where a robot's records go: a connector group, a generic netlink port, or a Unix datagram socket."""

    transport: Literal["netlink", "nl80211", "unix"]
    connector_idx: Annotated[int, Meta(ge=1, le=32)] = 26
    path: str = ""
    """Of the Unix socket; the service binds it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotScenario:
    """One robot's card, antennas, clocks and camera."""

    mac: Mac
    csi: CsiEndpoint
    pose_socket: Text
    """The service binds it; poses are lost until it is there."""
    antennas_m: tuple[Vector3, Vector3, Vector3]
    """Antennas A, B, C from the camera, in body axes (forward, left, up). A transmits."""
    antenna_gain_db: Vector3 = (0.0, -22.0, -24.0)
    """Of each receive chain: only A carries signal in the real captures."""
    oscillator_ppm: Annotated[float, Meta(ge=-50, le=50)] = 0.0
    """Of the card's crystal: it moves the carrier and the card's clock alike."""
    clock_offset_s: float = 0.0
    """Of the host's wall clock."""
    frame_yaw_rad: float = 0.0
    """Turn, counter-clockwise, from the tracker's own axes to true East and North."""


def bare_robot(name: str, mac: str, oscillator_ppm: float, clock_offset_s: float) -> RobotScenario:
    """One with its antennas on the tracked point and 6 cm beside it, of which one hears; for worlds that open no
    socket."""
    return RobotScenario(
        mac=mac,
        csi=CsiEndpoint("unix", path=name),
        pose_socket=name,
        antennas_m=((0.0, 0.0, 0.0), (0.0, 0.06, 0.0), (0.0, -0.06, 0.0)),
        antenna_gain_db=(0.0, -22.0, -24.0),
        oscillator_ppm=oscillator_ppm,
        clock_offset_s=clock_offset_s,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """The whole simulated world. The flying robot starts on the ground at the origin, the beacon stands around it."""

    seed: Annotated[int, Meta(ge=0)]
    uav: RobotScenario
    beacon: RobotScenario
    truth_in: Text
    """Socket the world binds; the mock autopilot sends VehicleTruth to it."""
    truth_out: Text
    """Socket the demo binds; WorldTruth is sent to it."""
    radio: RadioScenario = field(default_factory=RadioScenario)
    vio: VioScenario = field(default_factory=VioScenario)
    start_distance_m: Positive = 15.0
    beacon_azimuth_rad: float | None = None
    """Where the beacon starts, seen from the origin; drawn from the seed when absent."""
    beacon_floor_m: Annotated[float, Meta(ge=-2, le=2)] = 0.0
    """By how much the ground the beacon drives on is above that which the vehicle starts from."""
    drive_azimuth_rad: float | None = None
    """Where the beacon drives (and looks); drawn from the seed when absent."""
    drive_speed_m_s: NotNegative = 0.1
    drive_below_share: Fraction = 0.5
    """The beacon starts to drive when the distance has fallen below this share of start_distance_m."""
    drive_after_m: Positive | None = None
    """Where given, it starts as soon as the vehicle is so far, across the ground, from its own start."""
    drive_straight_m: NotNegative | None = None
    """Where given, the beacon's course is closed: so far straight on, half a circle to the left, back, half a circle.
    Absent, it drives straight on without end."""
    drive_turn_radius_m: Positive = 2.0
    lag_s: Annotated[float, Meta(ge=0.0, le=0.2)] = 0.03
    """At a time T the vehicle stands where its autopilot said it was at T - lag_s: positions are then always
    interpolated, never extrapolated, and poses, packets and WorldTruth agree with each other exactly."""


def load_scenario(path: Path) -> Scenario:
    """Raises ConfigError naming the file and the key."""
    try:
        text = read_regular(path)
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the scenario: {error.strerror}") from None
    try:
        scenario = msgspec.json.decode(text, type=Scenario)
    except msgspec.DecodeError as error:
        raise ConfigError(f"{path}: {error}") from None
    unknown = _unknown_keys(msgspec.json.decode(text), msgspec.to_builtins(scenario), "")
    if unknown:
        raise ConfigError(f"{path}: unknown keys: {', '.join(unknown)}")
    for name, robot in (("uav", scenario.uav), ("beacon", scenario.beacon)):
        if robot.csi.transport == "unix" and not robot.csi.path:
            raise ConfigError(f"{path}: {name}.csi.path: missing; transport unix needs the path of a socket")
    return scenario


def encode_scenario(scenario: Scenario) -> bytes:
    """The JSON that `load_scenario` reads."""
    return msgspec.json.format(msgspec.json.encode(scenario), indent=2)


def _unknown_keys(given: Any, known: Any, path: str) -> list[str]:
    # msgspec ignores unknown keys of dataclasses; a misspelt key must not silently become a default.
    if isinstance(given, dict) and isinstance(known, dict):
        unknown = [f"{path}.{key}".lstrip(".") for key in given if key not in known]
        for key in given.keys() & known.keys():
            unknown += _unknown_keys(given[key], known[key], f"{path}.{key}".lstrip("."))
        return unknown
    if isinstance(given, list) and isinstance(known, (list, tuple)):
        pairs = enumerate(zip(given, known, strict=True))
        return [key for i, (item, like) in pairs for key in _unknown_keys(item, like, f"{path}[{i}]")]
    return []
