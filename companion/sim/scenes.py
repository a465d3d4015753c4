"""Named rooms and what happens in them: the worlds in which missions are judged.

A scene turns a scenario of two robots into that of one room, drawn from the scenario's seed. All reflecting planes lie
beyond both robots and every place the ground robot drives to: a wall between the two would mirror one of them to the
near side, with a shorter way than the direct one. A mirror image stands behind its wall, where nobody can fly: missions
at virtual time end there as a crash (`is_outside`); in the demo planes are mirrors alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.config.schema import GateConfig
from companion.core.messages import Vector3
from companion.errors import ConfigError
from companion.sim.scenario import RadioScenario, Reflector, Scatterer, Scenario, VioScenario
from companion.sim.trajectory import BeaconDrive

Array = npt.NDArray[np.float64]

FLIGHT_HEIGHT_M: Final = 1.5
"""Ceilings are counted from here; missions fly at about this height."""
_SCENE_STREAM: Final = 5
_FLOOR_STREAM: Final = 6
_UNEVEN_M: Final = 0.2
"""Deviation of how much higher the ground is where the beacon stands: floors are not even, and a height above the
ground that somebody configured is measured with a tape or guessed."""
_WITHIN_M: Final = 0.7
"""A fence is set this far within the walls."""
_SHADOWING_DB: Final = 3.0
_UP: Final[Vector3] = (0.0, 0.0, 1.0)
_HALL_GAIN: Final = (0.1, 0.3)
_HALL_BEYOND_M: Final = (6.0, 12.0)
_HARD_GAIN: Final = (0.3, 0.6)
_HARD_BEYOND_M: Final = (2.0, 6.0)
_SCATTERERS: Final = 12
_LEAST_M2: Final = 0.3
_MOST_M2: Final = 10.0
"""Radar cross sections, from a chair's to a steel cabinet's."""
_AROUND_M: Final = 3.0
_CLEAR_M: Final = 1.0
"""Nothing stands nearer than this to where a robot starts."""
_STRAIGHT_M: Final = (6.0, 10.0)
_TURN_RADIUS_M: Final = (1.5, 2.5)

Room = Callable[[np.random.Generator, Array], RadioScenario]


@dataclass(frozen=True, slots=True)
class Scene:
    """`room` is drawn around places (N, 3). A speed without `from_start` begins at half the distance."""

    room: Room
    distance_m: float = 15.0
    direct_gain: float = 1.0
    drive_speed_m_s: float = 0.0
    from_start: bool = False
    drives: bool = False
    """The receiver is a rover."""
    vio_bias_std: float | None = None
    north_error_rad: float = 0.0


def open_ground(rng: np.random.Generator, places_m: npt.ArrayLike) -> RadioScenario:
    """Nothing but the ground."""
    return RadioScenario(reflectors=(_floor(rng, places_m),))


def hall(rng: np.random.Generator, places_m: npt.ArrayLike) -> RadioScenario:
    """A floor, and two walls at right angles 6 to 12 m beyond the places (N, 3), of gain 0.1 to 0.3 and any phase."""
    walls = _walls(rng, places_m, 2, _HALL_BEYOND_M, gain=_HALL_GAIN)
    return RadioScenario(reflectors=(_floor(rng, places_m), *walls))


def hard_room(rng: np.random.Generator, places_m: npt.ArrayLike) -> RadioScenario:
    """Four walls 2 to 6 m beyond the places (N, 3) and a ceiling as far above the flight, of random gain 0.3 to 0.6 and
    phase; the floor of the hall."""
    walls = _walls(rng, places_m, 4, _HARD_BEYOND_M, gain=_HARD_GAIN)
    ceiling = _plane(rng, _UP, FLIGHT_HEIGHT_M + rng.uniform(*_HARD_BEYOND_M), _HARD_GAIN)
    return RadioScenario(reflectors=(_floor(rng, places_m), *walls, ceiling))


def furnished(rng: np.random.Generator, places_m: npt.ArrayLike) -> RadioScenario:
    """The hard room with waves that two of its sides turn one after the other, and a dozen scatterers of 0.3 to 10 m2
    between the places (N, 3) and up to 3 m around them."""
    room = replace(hard_room(rng, places_m), reflection_order=2)
    return replace(room, scatterers=_scatterers(rng, np.asarray(places_m), room))


_SCENES: Final = {
    "open": Scene(open_ground),
    "hall": Scene(hall),
    "far": Scene(hall, distance_m=30.0),
    "moving-0.1": Scene(hall, drive_speed_m_s=0.1),
    "moving-0.3": Scene(hall, drive_speed_m_s=0.3, from_start=True),
    "hard": Scene(hard_room),
    "hard-10db": Scene(hard_room, direct_gain=10 ** (-10 / 20)),
    "hard-14db": Scene(hard_room, direct_gain=10 ** (-14 / 20)),
    "furniture": Scene(furnished),
    "drift": Scene(hall, vio_bias_std=0.07),
    "north": Scene(hall, north_error_rad=math.radians(10.0)),
    "ground": Scene(hall, drives=True),
    "occluded": Scene(hall, direct_gain=10 ** (-10 / 20), drive_speed_m_s=0.1),
}
SCENES: Final = tuple(_SCENES)
"""Their names. In `ground` a rover looks for the robot; `occluded` is the paper's mission: out of sight, with a robot
that drives off on the way."""
FLOWN: Final = tuple(name for name, scene in _SCENES.items() if not scene.drives)
"""Those in which missions at virtual time fly."""


def scene_names(names: Sequence[str], known: Sequence[str] = SCENES) -> tuple[str, ...]:
    """The names themselves. Raises ConfigError naming one that is none of `known`, and all there are."""
    for name in names:
        if name not in known:
            raise ConfigError(f"scene {name!r} is unknown; expected one of {', '.join(known)}")
    return tuple(names)


def drives(name: str) -> bool:
    """Whether the receiver of a scene is a rover."""
    return _SCENES[name].drives


def set_in(
    base: Scenario, name: str, *, distance_m: float | None = None, north_error_rad: float | None = None
) -> Scenario:
    """The scenario in a scene: its robots, clocks, cameras and sockets, and of the radio what is not the room's. Where
    it does not say where the beacon stands and drives to, that is drawn as well. `distance_m` and `north_error_rad` are
    in place of the scene's own. Raises ConfigError for no name."""
    (known,) = scene_names([name])
    scene = _SCENES[known]
    if distance_m is not None:
        scene = replace(scene, distance_m=distance_m)
    if north_error_rad is not None:
        scene = replace(scene, north_error_rad=north_error_rad)
    rng = np.random.default_rng([base.seed, _SCENE_STREAM])
    driving = _driving(base, scene, rng)
    room = scene.room(rng, np.concatenate([np.zeros((1, 3)), BeaconDrive(driving).places_m()]))
    sign = math.copysign(1.0, rng.uniform(-1.0, 1.0))
    radio = replace(
        base.radio,
        direct_gain=scene.direct_gain,
        reflectors=room.reflectors,
        reflection_order=room.reflection_order,
        scatterers=room.scatterers,
        shadowing_db=_SHADOWING_DB,
    )
    frame_yaw_rad = base.uav.frame_yaw_rad + sign * scene.north_error_rad
    return replace(driving, radio=radio, vio=_vio(base.vio, scene), uav=replace(base.uav, frame_yaw_rad=frame_yaw_rad))


def is_outside(radio: RadioScenario, p_enu_m: Vector3) -> bool:
    """Whether a place is beyond one of the planes, seen from the start of the flight."""
    inside = np.array([0.0, 0.0, FLIGHT_HEIGHT_M])
    return any(
        (np.dot(plane.normal, p_enu_m) - plane.offset_m) * (np.dot(plane.normal, inside) - plane.offset_m) < 0
        for plane in radio.reflectors
    )


def fence_in(radio: RadioScenario, fence: GateConfig) -> GateConfig:
    """The fence that a person sets who knows the room: `fence`, drawn in to a little within the walls and the ceiling.
    Walls are at right angles to each other."""
    walls = [plane for plane in radio.reflectors if plane.normal[2] == 0.0]
    ceilings_m = [plane.offset_m for plane in radio.reflectors if plane.normal[2] > 0.0 and plane.offset_m > 0.0]
    low, high = list(fence.fence_min_m), list(fence.fence_max_m)
    high[2] = min([high[2], *(ceiling_m - _WITHIN_M for ceiling_m in ceilings_m)])
    yaw_rad = math.atan2(walls[0].normal[1], walls[0].normal[0]) if walls else 0.0
    for wall in walls:
        turn = round(math.remainder(math.atan2(wall.normal[1], wall.normal[0]) - yaw_rad, math.tau) / (math.pi / 2)) % 4
        edge_m, axis = wall.offset_m - _WITHIN_M, turn % 2
        if turn < 2:
            high[axis] = min(high[axis], edge_m)
        else:
            low[axis] = max(low[axis], -edge_m)
    return replace(
        fence,
        fence_min_m=(low[0], low[1], low[2]),
        fence_max_m=(high[0], high[1], high[2]),
        fence_yaw_deg=math.degrees(yaw_rad),
    )


def _driving(base: Scenario, scene: Scene, rng: np.random.Generator) -> Scenario:
    """Away from the vehicle or across its way, round a course that stays in the room."""
    azimuth_rad = rng.uniform(-math.pi, math.pi) if base.beacon_azimuth_rad is None else base.beacon_azimuth_rad
    drive_rad = azimuth_rad + rng.uniform(-math.pi / 2, math.pi / 2)
    floor_rng = np.random.default_rng([base.seed, _FLOOR_STREAM])
    return replace(
        base,
        start_distance_m=scene.distance_m,
        beacon_floor_m=float(floor_rng.normal(0.0, _UNEVEN_M)),
        beacon_azimuth_rad=azimuth_rad,
        drive_azimuth_rad=drive_rad if base.drive_azimuth_rad is None else base.drive_azimuth_rad,
        drive_speed_m_s=scene.drive_speed_m_s,
        drive_after_m=0.5 if scene.from_start else None,
        drive_straight_m=rng.uniform(*_STRAIGHT_M),
        drive_turn_radius_m=rng.uniform(*_TURN_RADIUS_M),
    )


def _vio(vio: VioScenario, scene: Scene) -> VioScenario:
    return vio if scene.vio_bias_std is None else replace(vio, bias_std=scene.vio_bias_std)


def _walls(
    rng: np.random.Generator,
    places_m: npt.ArrayLike,
    count: int,
    beyond_m: tuple[float, float],
    *,
    gain: tuple[float, float],
) -> list[Reflector]:
    """Upright, at right angles; each so far beyond the place that is nearest to it."""
    azimuth = rng.uniform(-math.pi, math.pi)
    walls = []
    for number in range(count):
        turned = azimuth + number * math.pi / 2
        normal = (math.cos(turned), math.sin(turned), 0.0)
        nearest_m = float(np.max(np.asarray(places_m) @ np.array(normal)))
        walls.append(_plane(rng, normal, nearest_m + rng.uniform(*beyond_m), gain))
    return walls


def _floor(rng: np.random.Generator, places_m: npt.ArrayLike) -> Reflector:
    """Of the hall's gain, under all places (N, 3)."""
    return _plane(rng, _UP, min(0.0, float(np.min(np.asarray(places_m)[:, 2]))), _HALL_GAIN)


def _plane(rng: np.random.Generator, normal: Vector3, offset_m: float, gain: tuple[float, float]) -> Reflector:
    return Reflector(normal, offset_m, rng.uniform(*gain), rng.uniform(-math.pi, math.pi))


def _scatterers(rng: np.random.Generator, places_m: Array, room: RadioScenario) -> tuple[Scatterer, ...]:
    low, high = places_m.min(axis=0) - _AROUND_M, places_m.max(axis=0) + _AROUND_M
    low[2], high[2] = 0.2, 2.2
    found: list[Scatterer] = []
    while len(found) < _SCATTERERS:
        x, y, z = rng.uniform(low, high).tolist()
        cross_section_m2 = math.exp(rng.uniform(math.log(_LEAST_M2), math.log(_MOST_M2)))
        is_clear = np.hypot(*(places_m[:, :2] - (x, y)).T).min() > _CLEAR_M
        if is_clear and not is_outside(room, (x, y, z)):
            found.append(Scatterer((x, y, z), cross_section_m2, rng.uniform(-math.pi, math.pi)))
    return tuple(found)
