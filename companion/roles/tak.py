"""What TAK is told by a running service."""

from __future__ import annotations

from typing import Final

import msgspec

from companion.config.schema import Config
from companion.core.event_clock import EventClock
from companion.core.recorder import Recorder
from companion.errors import ConfigError
from companion.roles.fed import FedProcess

TAK: Final = "companion.tak.sender"


class Tak(FedProcess):
    """Raises ConfigError when a key could be read by others, or a file of it is not there."""

    name = "TAK sender"
    module = TAK

    def __init__(self, config: Config, clock: EventClock, recorder: Recorder) -> None:
        if config.tak.enabled and config.tak.transport == "tls":
            _check_files(config)
        super().__init__(config, clock, recorder, config.tak.enabled)

    def settings(self) -> str:
        config, tak = self._config, self._config.tak
        files = {name: _file(config, name) for name in ("ca_file", "cert_file", "key_file")}
        settings = {
            "transport": tak.transport,
            "address": tak.address,
            "port": tak.port,
            "ttl": tak.ttl,
            "interface": tak.interface,
            "period_s": tak.period_s,
            "telling": {
                "uid": f"wsr-companion.{config.id}.{config.name}",
                "callsign": tak.callsign or config.name,
                "wedge_m": tak.wedge_m,
                "stale_s": tak.stale_s,
            },
            **files,
        }
        return msgspec.json.encode(settings).decode()


def _file(config: Config, name: str) -> str:
    value = getattr(config.tak, name)
    return "" if value is None else str(config.path(value))


def _check_files(config: Config) -> None:
    for name in ("ca_file", "cert_file", "key_file"):
        path = config.path(_file(config, name))
        try:
            mode = path.stat().st_mode
        except OSError as error:
            raise ConfigError(f"tak.{name}: {path}: {error.strerror}") from None
        if name == "key_file" and mode & 0o077:
            raise ConfigError(f"tak.key_file: {path} can be read by others (mode {mode & 0o777:o}); chmod 600 {path}")
