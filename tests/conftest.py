"""Settings all tests share."""

from __future__ import annotations

from hypothesis import settings

# Machines are noisy: what takes how long is judged in benchmarks, never by a deadline on an example.
settings.register_profile("companion", deadline=None)
settings.load_profile("companion")
