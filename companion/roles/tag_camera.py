"""The tag camera of a running service: its process, kept alive, and what it tells, taken one event after the other."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from importlib.util import find_spec
from typing import Final

from companion.camera.settings import reader_settings
from companion.camera.sighting import TagFrame
from companion.camera.source import TagSource
from companion.config.schema import Config
from companion.errors import ConfigError
from companion.host.fed_process import keep_fed

_log = logging.getLogger(__name__)
READER: Final = "companion.camera.reader"
_EXTRA: Final = "tag_camera.enabled: needs the library opencv-python-headless: pip install 'wsr-companion[apriltag]'"


class TagCamera:
    """With `tag_camera.enabled` off nothing is started. What fails later costs the flight the camera alone. Raises
    ConfigError where the library is not installed."""

    def __init__(self, config: Config, on_frame: Callable[[TagFrame], None]) -> None:
        if config.tag_camera.enabled and find_spec("cv2") is None:
            raise ConfigError(_EXTRA)
        self._config = config
        self._on_frame = on_frame
        self._source: TagSource | None = None
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Beside the service's tasks and not one of them."""
        if not self._config.tag_camera.enabled:
            return
        self._source = TagSource(self._on_frame)
        settings = reader_settings(self._config)
        self._task = asyncio.create_task(
            keep_fed("tag camera", READER, settings, self._source.attach), name="tag camera"
        )
        self._task.add_done_callback(_tell_failure)

    async def aclose(self) -> None:
        """Harmless when repeated."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait({self._task})
        if self._source is not None:
            self._source.close()


def _tell_failure(task: asyncio.Task[None]) -> None:
    if not task.cancelled() and (error := task.exception()) is not None:
        _log.error("the tag camera has failed: %r; the service goes on without it", error)
