"""Indices of the kernel's netlink connector. They are one for the whole machine: whoever wants some claims them, so
that tests side by side, and a demo beside them, do not hear each other.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import pytest

from companion.sim.stage import claim_connectors
from csi_bridge.netlink import connector_available

_INDICES: Final = range(10, 26)
"""Not the driver's own, which is also the one that everybody tries to see whether there is a connector."""
UNAVAILABLE: Final = connector_available()
needs_netlink = pytest.mark.skipif(UNAVAILABLE is not None, reason=f"netlink connector: {UNAVAILABLE}")


@contextmanager
def claimed(count: int) -> Iterator[list[int]]:
    """So many indices, for as long as the context is open."""
    claims = claim_connectors(count, _INDICES)
    try:
        yield sorted(claims)
    finally:
        for claim in claims.values():
            claim.close()
