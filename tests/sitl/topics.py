"""What the service itself records."""

from __future__ import annotations

from companion.core.streams import STREAMS, Part

SERVICE_TOPICS = {stream.topic for stream in STREAMS if stream.part is not Part.TRUTH}
