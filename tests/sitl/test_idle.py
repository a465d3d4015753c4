"""What a service costs that waits, as far as another machine's load does not change it."""

from __future__ import annotations

import pytest

from benchmarks.idle import idle_cost

pytestmark = pytest.mark.long


def test_an_idle_service_is_small_soon_ready_and_soon_gone() -> None:
    cost = idle_cost(seconds=5.0)
    print(cost)
    assert {one.name for one in cost.processes} == {"service", "worker", "page"}
    assert cost.memory_mb < 150.0
    assert cost.csi_per_s > 50.0 and cost.poses_per_s > 50.0, "all streams were live"
    assert cost.start_processor_s < 2.5 and cost.stop_s < 2.0
    assert cost.log_is_whole
    service = next(one for one in cost.processes if one.name == "service")
    # 40 turns of the sockets, half of them with the tick, and little else; more where senders are held up.
    assert service.loop_wakes_per_s < 150.0
