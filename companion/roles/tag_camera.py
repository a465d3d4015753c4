"""The tag camera of a running service: its process, kept alive, and what it tells, taken one event after the other."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Final

from companion.camera.settings import reader_settings
from companion.camera.sighting import TagFrame
from companion.camera.source import TagSource
from companion.config.schema import Config
from companion.errors import ConfigError
from companion.host.beside import Beside
from companion.host.fed_process import keep_fed

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
        self._reader = Beside("tag camera")

    def start(self) -> None:
        """Beside the service's tasks and not one of them."""
        if not self._config.tag_camera.enabled:
            return
        self._source = TagSource(self._on_frame)
        settings = reader_settings(self._config)
        self._reader.start(keep_fed("tag camera", READER, settings, self._source.attach))

    async def aclose(self) -> None:
        """Harmless when repeated."""
        await self._reader.aclose()
        if self._source is not None:
            self._source.close()
