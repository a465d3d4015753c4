"""The camera's process: it looks, tells, and ends where there is nothing to look at."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from companion.camera.settings import ReaderSettings, settings_text
from companion.camera.sighting import MAX_BYTES, TagFrame, decode

_FEW_S = 20.0


def _settings(source: Path) -> str:
    return settings_text(
        ReaderSettings(
            source=str(source), family="tag36h11", sizes_m={7: 0.16}, size_px=(640, 480), focal_px=(600.0, 600.0),
            centre_px=(320.0, 240.0), distortion=(0.0,) * 5, rate_hz=50.0, delay_s=0.0,
        )
    )  # fmt: skip


def _run(*command: str) -> tuple[list[TagFrame], subprocess.CompletedProcess[str]]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        done = subprocess.run(
            [sys.executable, *command], stdin=theirs.fileno(), capture_output=True, text=True, timeout=_FEW_S
        )
        theirs.close()
        frames = []
        while data := ours.recv(MAX_BYTES):
            frames.append(decode(data))
    return frames, done


def test_a_folder_is_looked_at_and_every_image_told(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2", reason="needs the extra apriltag")
    from benchmarks.tag_images import View, tag_image

    rng = np.random.default_rng(1)
    for number in (7, 8):
        cv2.imwrite(str(tmp_path / f"{number}.png"), tag_image(View(distance_m=1.5, tilt_rad=0.4), number, rng))
    cv2.imwrite(str(tmp_path / "9.png"), np.zeros((480, 640), np.uint8))
    frames, done = _run("-m", "companion.camera.reader", _settings(tmp_path))
    assert (done.returncode, done.stderr) == (0, "")
    assert [[tag.id for tag in frame.tags] for frame in frames] == [[7], [8], []]
    assert frames[0].tags[0].p_camera_m == pytest.approx((0.0, 0.0, 1.5), abs=0.01)


def test_without_images_or_without_opencv_it_ends_with_words(tmp_path: Path) -> None:
    program = (
        "import sys; sys.modules['cv2'] = None; sys.argv = ['reader', '{}']; "
        "from companion.camera.reader import main; sys.exit(main())"
    )
    frames, done = _run("-c", program)
    assert (frames, done.returncode) == ([], 1)
    assert "OpenCV is not installed; expected the extra apriltag" in done.stderr
    pytest.importorskip("cv2", reason="needs the extra apriltag")
    frames, done = _run("-m", "companion.camera.reader", _settings(tmp_path / "none"))
    assert (frames, done.returncode) == ([], 1)
    assert done.stderr == f"tag camera: {tmp_path / 'none'}: no such camera, film or folder\n"


def test_a_camera_that_hangs_in_its_driver_ends_the_process(tmp_path: Path) -> None:
    pytest.importorskip("cv2", reason="needs the extra apriltag")
    program = (
        "import sys, time; from companion.camera import images, reader; reader._SILENT_S = 0.3; "
        "images.images = lambda *a: iter(lambda: time.sleep(30), None); "
        f"sys.argv = ['reader', {_settings(tmp_path)!r}]; sys.exit(reader.main())"
    )
    frames, done = _run("-c", program)
    assert (frames, done.returncode) == ([], -signal.SIGALRM)
