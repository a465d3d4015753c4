"""`python -m benchmarks.tags`: how well a tag's place is known by its image, by distance and tilt, and what is
believed of images that are spoiled. Needs the extra `apriltag`."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

import click
import cv2
import numpy as np

from benchmarks.tag_images import MATRIX, SIZE_M, View, empty_image, tag_image, tag_place
from companion.camera.detector import TagDetector
from companion.camera.place import Mounting
from companion.camera.sighting import Tag
from companion.guidance.camera_target import AGREES, doubt

DISTANCES_M: Final = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0)
TILTS_DEG: Final = (0, 30, 60)
OURS: Final = 7
_OTHERS: Final = 587
_MAX_RANGE_M: Final = 10.0
_ASIDE: Final = 0.4
_LEVEL: Final = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceErrors:
    """Of `images` of one kind of view: sightings that were believed, and how far off they put the tag."""

    distance_m: float
    tilt_deg: float
    images: int
    believed: int
    median_m: float | None
    worst_m: float | None
    worst_share: float | None
    """The worst squared normalised error over what is taken for true."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spoiled:
    """Of images of one kind: how many sightings of our tag were told, believed, and believed though false."""

    kind: str
    images: int
    told: int
    believed: int
    false: int


def detector() -> TagDetector:
    return TagDetector(family="tag36h11", sizes_m={OURS: SIZE_M}, other_size_m=SIZE_M, matrix=MATRIX)


def place_errors(images: int, seed: int = 1) -> list[PlaceErrors]:
    """By distance and tilt."""
    rng, tags = np.random.default_rng(seed), detector()
    return [
        _errors(tags, distance_m, tilt_deg, images, rng=rng) for distance_m in DISTANCES_M for tilt_deg in TILTS_DEG
    ]


def spoiled(images: int, seed: int = 2) -> list[Spoiled]:
    """By kind of image."""
    rng, tags = np.random.default_rng(seed), detector()
    return [_spoiled(tags, kind, make, images, rng=rng) for kind, make in KINDS.items()]


def _any_view(rng: np.random.Generator, distance_m: float | None = None, tilt_deg: float | None = None) -> View:
    distance_m = float(rng.uniform(0.6, 6.0)) if distance_m is None else distance_m
    inside = min(_ASIDE, 0.25 * distance_m)
    return View(
        distance_m=distance_m,
        tilt_rad=math.radians(float(rng.uniform(0, 60)) if tilt_deg is None else tilt_deg),
        turn_rad=float(rng.uniform(0, math.tau)),
        roll_rad=float(rng.uniform(0, math.tau)),
        aside=(float(rng.uniform(-inside, inside)), float(rng.uniform(-inside, inside))),
    )


def _another(rng: np.random.Generator) -> int:
    number = int(rng.integers(_OTHERS - 1))
    return number + (number >= OURS)


KINDS: Final[dict[str, Callable[[np.random.Generator], tuple[View, int | None]]]] = {
    "clear": lambda rng: (_any_view(rng), OURS),
    "wrong tag": lambda rng: (_any_view(rng), _another(rng)),
    "wrong tag, blurred": lambda rng: (replace(_any_view(rng), blur_px=float(rng.uniform(1, 3))), _another(rng)),
    "clutter without a tag": lambda rng: (_any_view(rng), None),
    "lens blurred by 1 to 3 px": lambda rng: (replace(_any_view(rng), blur_px=float(rng.uniform(1, 3))), OURS),
    "moved by 2 to 12 px": lambda rng: (replace(_any_view(rng), motion_px=float(rng.uniform(2, 12))), OURS),
    "glare upon it": lambda rng: (replace(_any_view(rng), glare=float(rng.uniform(0.2, 0.9))), OURS),
    "partly covered": lambda rng: (replace(_any_view(rng), covered=float(rng.uniform(0.05, 0.5))), OURS),
    "dark and noisy": lambda rng: (replace(_any_view(rng), light=float(rng.uniform(0.05, 0.3)), noise=6.0), OURS),
}


def _errors(
    tags: TagDetector, distance_m: float, tilt_deg: float, images: int, *, rng: np.random.Generator
) -> PlaceErrors:
    off_m, share = [], []
    for _ in range(images):
        view = _any_view(rng, distance_m, tilt_deg)
        for tag in _believed(tags.detect(tag_image(view, OURS, rng))):
            off_m.append(float(np.linalg.norm(np.array(tag.p_camera_m) - tag_place(view))))
            share.append(squared_error(tag, view) / AGREES)
    return PlaceErrors(
        distance_m=distance_m,
        tilt_deg=tilt_deg,
        images=images,
        believed=len(off_m),
        median_m=float(np.median(off_m)) if off_m else None,
        worst_m=max(off_m, default=None),
        worst_share=max(share, default=None),
    )


def _spoiled(
    tags: TagDetector,
    kind: str,
    make: Callable[[np.random.Generator], tuple[View, int | None]],
    images: int,
    *,
    rng: np.random.Generator,
) -> Spoiled:
    told = believed = false = 0
    for _ in range(images):
        view, number = make(rng)
        found = tags.detect(empty_image(rng) if number is None else tag_image(view, number, rng))
        ours = [tag for tag in found if tag.id == OURS]
        told += len(ours)
        for tag in _believed(ours):
            believed += 1
            false += number != OURS or squared_error(tag, view) > AGREES
    return Spoiled(kind=kind, images=images, told=told, believed=believed, false=false)


def _believed(found: list[Tag]) -> list[Tag]:
    return [tag for tag in found if tag.id == OURS and doubt(tag, _MAX_RANGE_M) is None]


def squared_error(tag: Tag, view: View) -> float:
    """Normalised by the covariance that the flight takes, of a level vehicle at the origin that looks East."""
    seen = Mounting((0.0, 0.0, 0.0), 0.0, 0.0, 0.0).place(tag, (0.0, 0.0, 0.0), _LEVEL)
    x, y, z = tag_place(view)
    off_m = seen.p_local_enu_m - np.array([z, -x, -y])
    return float(off_m @ np.linalg.solve(seen.covariance_m2, off_m))


@click.command()
@click.option("--images", type=click.IntRange(min=1), default=200, show_default=True, help="Of each kind.")
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the figures here.")
def main(images: int, json_path: Path | None) -> None:
    """Tags of 16 cm, 640 x 480 pixels, focal length 600 px: tables as docs/camera.md has them."""
    cv2.setNumThreads(1)
    begun_s = time.monotonic()
    rows = place_errors(images)
    click.echo("| distance (side in pixels) | tilt | believed | median error | worst |\n|---|---|---|---|---|")
    for row in rows:
        off = "- | -" if row.median_m is None or row.worst_m is None else f"{_cm(row.median_m)} | {_cm(row.worst_m)}"
        side_px = MATRIX[0, 0] * SIZE_M / row.distance_m
        share = f"{100 * row.believed / row.images:.0f} %"
        click.echo(f"| {row.distance_m:g} m ({side_px:.0f}) | {row.tilt_deg:g}° | {share} | {off} |")
    kinds = spoiled(images)
    click.echo("\n| images | told | believed | believed though false |\n|---|---|---|---|")
    for kind in kinds:
        click.echo(f"| {kind.kind} | {kind.told} of {kind.images} | {kind.believed} | {kind.false} |")
    click.echo(f"\n{time.monotonic() - begun_s:.0f} s")
    if json_path is not None:
        figures = {"places": [asdict(row) for row in rows], "spoiled": [asdict(kind) for kind in kinds]}
        json_path.write_text(json.dumps(figures, indent=2) + "\n")


def _cm(metres: float) -> str:
    return f"{100 * metres:.1f} cm"


if __name__ == "__main__":
    main()
