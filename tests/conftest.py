"""Settings all tests share."""

from __future__ import annotations

import gc
import signal

from hypothesis import settings

pytest_plugins = ["tests.processor"]

# Three hundred modules are read: nothing of that is garbage, and to look for some takes a seventh of the time.
gc.disable()

# Machines are noisy: what takes how long is judged in benchmarks, never by a deadline on an example.
settings.register_profile("companion", deadline=None)
settings.load_profile("companion")

# A shell without job control starts what runs in the background with SIGINT ignored, and every process that a test
# starts would inherit it: none could be interrupted any more.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()
