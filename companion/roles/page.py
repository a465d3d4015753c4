"""The page of a running service."""

from __future__ import annotations

from typing import Final

import msgspec

from companion.config.schema import Config
from companion.core.event_clock import EventClock
from companion.core.recorder import Recorder
from companion.host.token import read_token
from companion.roles.fed import FedProcess

PAGE: Final = "companion.page.server"


class Page(FedProcess):
    """Raises ConfigError when the token cannot be read."""

    name = "page"
    module = PAGE

    def __init__(self, config: Config, clock: EventClock, recorder: Recorder) -> None:
        if config.page.enabled and config.page.token_file is not None:
            read_token(config.path(config.page.token_file))
        super().__init__(config, clock, recorder, config.page.enabled)

    def settings(self) -> str:
        config, page = self._config, self._config.page
        token = None if page.token_file is None else str(config.path(page.token_file))
        control = str(config.path(config.control_socket)) if page.allow_engage else None
        settings = {"address": page.address, "port": page.port, "token_file": token, "control_socket": control}
        return msgspec.json.encode(settings).decode()
