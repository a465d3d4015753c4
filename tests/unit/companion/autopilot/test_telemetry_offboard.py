"""What telemetry keeps of a mode that was lost and is back."""

from __future__ import annotations

from tests.unit.companion.autopilot.telemetry_bench import TelemetryBench


def test_leaving_offboard_is_counted_though_it_is_back_at_once() -> None:
    bench = TelemetryBench()
    offboard, hold = {"custom_mode": 6 << 16}, {"custom_mode": 4 << 16 | 3 << 24}
    for fields in (hold, offboard, offboard, hold, offboard, hold, hold):
        bench.take("CURRENT_MODE", fields)
    assert bench.telemetry.state().offboard_left == 2
    bench.take("ATTITUDE", {"time_boot_ms": 90_000, "yaw": 0.0})
    bench.take("ATTITUDE", {"time_boot_ms": 1_000, "yaw": 0.0})
    assert (bench.telemetry.state().boots, bench.telemetry.state().offboard_left) == (1, 2)
