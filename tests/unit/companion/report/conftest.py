"""The golden flight, gathered once for all tests of the room."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from companion.log.reader import open_session
from companion.report.content import FlightContent, gather
from tests.golden.golden_logs import GOLDEN


@pytest.fixture(scope="package")
def content() -> Iterator[FlightContent]:
    yield gather(open_session(GOLDEN[0]))
