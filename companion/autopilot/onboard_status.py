"""ONBOARD_COMPUTER_STATUS of this computer, from /proc and /sys. MAVLink common.xml message 390.

What is not known is sent as the message definition wants it: 255 for a share, 127 for a temperature, the type's
largest value for an amount.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any, Final

_MIB: Final = 1 << 20
_U8, _I8, _I16, _U32 = 255, 127, 32767, 4294967295


def fields() -> dict[str, Any]:
    """Every field of the message by name; it costs a few small reads."""
    cores = os.cpu_count() or 1
    load = min(100, round(100 * os.getloadavg()[0] / cores))
    ram_mib, free_mib = _memory_mib()
    disk = os.statvfs("/")
    return {
        "time_usec": time.time_ns() // 1000,
        "uptime": round(time.clock_gettime(time.CLOCK_BOOTTIME) * 1000) & _U32,
        "type": 0,
        "cpu_cores": [_U8] * 8,
        "cpu_combined": [load] + [_U8] * 9,
        "gpu_cores": [_U8] * 4,
        "gpu_combined": [_U8] * 10,
        "temperature_board": _I8,
        "temperature_core": [_temperature_c()] + [_I8] * 7,
        "fan_speed": [_I16] * 4,
        "ram_usage": ram_mib - free_mib,
        "ram_total": ram_mib,
        "storage_type": [0] + [_U32] * 3,
        "storage_usage": [(disk.f_blocks - disk.f_bavail) * disk.f_frsize // _MIB & _U32] + [_U32] * 3,
        "storage_total": [disk.f_blocks * disk.f_frsize // _MIB & _U32] + [_U32] * 3,
        "link_type": [_U32] * 6,
        "link_tx_rate": [_U32] * 6,
        "link_rx_rate": [_U32] * 6,
        "link_tx_max": [_U32] * 6,
        "link_rx_max": [_U32] * 6,
    }


def _memory_mib() -> tuple[int, int]:
    """Total and available."""
    rows = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
    total, free = (int(rows[name].split()[0]) // 1024 for name in ("MemTotal", "MemAvailable"))
    return total, free


def _temperature_c() -> int:
    try:
        return min(_I8 - 1, int(Path("/sys/class/thermal/thermal_zone0/temp").read_text()) // 1000)
    except (OSError, ValueError):
        return _I8
