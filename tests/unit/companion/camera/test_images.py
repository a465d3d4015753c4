"""Where images come from: folders and films; a camera is not there."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="needs the extra apriltag")

from companion.camera.images import ImageError, images  # noqa: E402

_SIZE = (64, 48)


def _picture(path: Path, brightness: int, size: tuple[int, int] = _SIZE) -> None:
    cv2.imwrite(str(path), np.full((size[1], size[0], 3), brightness, np.uint8))


def test_a_folder_is_shown_in_the_order_of_its_numbers_at_the_rate_that_is_asked(tmp_path: Path) -> None:
    for number in (10, 9, 1):
        _picture(tmp_path / f"{number}.png", number)
    (tmp_path / "notes.txt").write_text("no picture")
    begun_ns = time.monotonic_ns()
    shown = list(images(str(tmp_path), 50.0, _SIZE, 0.0))
    assert [int(image[0, 0]) for _, image in shown] == [1, 9, 10]
    assert all(image.shape == (48, 64) for _, image in shown)
    times = [t_ns for t_ns, _ in shown]
    assert times == sorted(times) and begun_ns <= times[0]
    assert times[-1] - begun_ns >= 38_000_000, "since it began: the first may come late"


def test_a_film_is_shown_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "film.avi"
    film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, _SIZE)
    for brightness in (20, 200):
        film.write(np.full((48, 64, 3), brightness, np.uint8))
    film.release()
    assert [int(image.mean()) > 100 for _, image in images(str(path), 60.0, _SIZE, 0.0)] == [False, True]


def test_what_gives_no_images_is_told_with_what_would_be_right(tmp_path: Path) -> None:
    _picture(tmp_path / "1.png", 1)
    empty, text = tmp_path / "empty", tmp_path / "text"
    empty.mkdir()
    text.write_text("no film")
    for source, words in (
        (tmp_path, r"images are 64 x 48 pixels; expected 640 x 480, .*tag_camera\.size_px"),
        (empty, r"holds no picture; expected files that end in \.bmp"),
        (text, "not a film that OpenCV reads"),
        (tmp_path / "none", "no such camera, film or folder"),
    ):
        with pytest.raises(ImageError, match=words):
            next(images(str(source), 50.0, (640, 480), 0.0))
    (tmp_path / "1.png").write_text("no picture")
    with pytest.raises(ImageError, match="not a picture that OpenCV reads"):
        next(images(str(tmp_path), 50.0, _SIZE, 0.0))
