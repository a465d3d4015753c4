"""The process that looks for tags: `python -m companion.camera.reader SETTINGS`, its standard input one end of a socket
pair. For each image one datagram (`sighting`), whether there is a tag in it or not: that says that the camera lives.

It contains that camera's faults. Where images end, or none has come for `_SILENT_S`, it ends, and whoever started it
starts another; where nobody reads, what it would tell is dropped. Needs the extra `apriltag`.
"""

from __future__ import annotations

import contextlib
import signal
import socket
import sys
from typing import TYPE_CHECKING, Final

from companion.camera.settings import ReaderSettings, settings_of
from companion.camera.sighting import TagFrame, encode

if TYPE_CHECKING:
    from companion.camera.detector import TagDetector

_SILENT_S: Final = 10.0
"""A camera that hangs in its driver hangs for good; OpenCV's own patience is as long."""
_MISSING: Final = "OpenCV is not installed; expected the extra apriltag: pip install 'wsr-companion[apriltag]'"


def main() -> int:
    """Exit 0 where a film or a folder has ended or nobody listens any more, 1 where there are no images."""
    try:
        import cv2
    except ImportError:
        print(f"tag camera: {_MISSING}", file=sys.stderr)
        return 1
    from companion.camera.images import ImageError

    cv2.setNumThreads(1)
    settings = settings_of(sys.argv[1])
    with socket.socket(fileno=sys.stdin.fileno()) as told:
        told.setblocking(False)
        try:
            _look(settings, told)
        except ImageError as error:
            print(f"tag camera: {error}", file=sys.stderr)
            return 1
        except ConnectionError:  # the service has gone
            return 0
    return 0


def _look(settings: ReaderSettings, told: socket.socket) -> None:
    """Raises ImageError, or ConnectionError when nobody holds the other end."""
    from companion.camera.images import images

    detector = _detector(settings)
    # The timer's default action ends a process, in a driver's call too. To open a camera counts as well.
    signal.setitimer(signal.ITIMER_REAL, _SILENT_S)
    for t_ns, image in images(settings.source, settings.rate_hz, settings.size_px, settings.delay_s):
        signal.setitimer(signal.ITIMER_REAL, _SILENT_S)
        tags = detector.detect(image)
        with contextlib.suppress(BlockingIOError):
            told.send(encode(TagFrame(t_mono_ns=t_ns, family=settings.family, tags=tuple(tags))))


def _detector(settings: ReaderSettings) -> TagDetector:
    from companion.camera.detector import TagDetector

    (fx, fy), (cx, cy) = settings.focal_px, settings.centre_px
    sizes = settings.sizes_m
    matrix = ((fx, 0.0, cx), (0.0, fy, cy), (0.0, 0.0, 1.0))
    return TagDetector(
        family=settings.family,
        sizes_m=sizes,
        other_size_m=max(sizes.values(), default=0.1),
        matrix=matrix,
        distortion=settings.distortion,
    )


if __name__ == "__main__":
    sys.exit(main())
