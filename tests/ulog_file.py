"""PX4's own log made from positions, laid out as PX4's logger writes it (https://docs.px4.io/main/en/dev_log/ulog_file_format
and src/modules/logger/messages.h): flag bits, formats with padding and nested types, information in one and in several
messages, parameters with defaults, several instances, sync, dropouts, text, a second subscription, appended data.

It is no recording of an autopilot: none that may be passed on is at hand.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import Final

Vector = tuple[float, float, float]

_MAGIC: Final = b"ULog\x01\x12\x35\x01"
_SYNC: Final = bytes((0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12))
_APPENDED: Final = 1

# As generated from msg/VehicleLocalPosition.msg: fields by falling size, padded to 8 bytes at the end.
_POSITION_FLOATS: Final = (
    "ref_alt", "x", "y", "z", "vx", "vy", "vz", "z_deriv", "delta_z", "delta_vz", "ax", "ay", "az", "heading",
    "unaided_heading", "delta_heading", "dist_bottom", "eph", "epv", "evh", "evv", "vxy_max", "vz_max", "hagl_min",
    "hagl_max",
)  # fmt: skip
_POSITION_BYTES: Final = (
    "bool xy_valid", "bool z_valid", "bool v_xy_valid", "bool v_z_valid", "uint8_t xy_reset_counter",
    "uint8_t z_reset_counter", "uint8_t vxy_reset_counter", "uint8_t vz_reset_counter", "uint8_t heading_reset_counter",
    "bool heading_good_for_control", "bool xy_global", "bool z_global", "bool dist_bottom_valid",
    "uint8_t dist_bottom_sensor_bitfield", "bool dead_reckoning",
)  # fmt: skip
_FORMATS: Final = (
    "vehicle_local_position:uint64_t timestamp;uint64_t timestamp_sample;uint64_t ref_timestamp;double ref_lat;"
    "double ref_lon;"
    + "".join(f"float {name};" for name in _POSITION_FLOATS)
    + "float[2] delta_xy;float[2] delta_vxy;"
    + "".join(f"{name};" for name in _POSITION_BYTES)
    + "uint8_t[1] _padding0;",
    "esc_report:uint64_t timestamp;int32_t esc_rpm;float esc_voltage;uint8_t esc_state;uint8_t[7] _padding0;",
    "esc_status:uint64_t timestamp;uint16_t counter;uint8_t esc_count;uint8_t[5] _padding0;esc_report[2] esc;",
    "battery_status:uint64_t timestamp;float voltage_v;float remaining;int8_t cell_count;uint8_t[7] _padding0;",
)
_POSITION, _ESC, _BATTERY, _BATTERY_2 = range(4)


def ulog_of(positions: Iterable[tuple[int, Vector]], before: int = 50) -> bytes:
    """A log with the positions (time since boot [us], NED [m]), behind `before` ones of an estimator not yet ready."""
    rows = sorted(positions)
    start_us = rows[0][0]
    data = [_subscription(0, _POSITION, "vehicle_local_position"), _subscription(0, _ESC, "esc_status")]
    data += [_subscription(0, _BATTERY, "battery_status"), _subscription(1, _BATTERY_2, "battery_status")]
    for index in range(before):
        t_us = start_us - (before - index) * 20_000
        data.append(_data(_POSITION, _local_position(t_us, (float("nan"), 0.0, 40.0), False)))
    for index, (t_us, ned_m) in enumerate(rows):
        data.append(_data(_POSITION, _local_position(t_us, ned_m, True)))
        if index % 20 == 0:
            data += [_data(number, _battery(t_us)) for number in (_BATTERY, _BATTERY_2)]
            data.append(_data(_ESC, _esc_status(t_us, index)))
        if index % 100 == 50:
            data += [_message("S", _SYNC), _message("O", struct.pack("<H", 12))]
            data.append(_message("L", struct.pack("<BQ", ord("6"), t_us) + b"[commander] Takeoff detected"))
            data.append(_message("C", struct.pack("<BHQ", ord("4"), 3, t_us) + b"[health] Battery unhealthy"))
            data.append(_parameter("float MPC_XY_CRUISE", struct.pack("<f", 5.0)))
    data.append(_message("R", struct.pack("<H", _BATTERY_2)))
    body = b"".join(_definitions(start_us)) + b"".join(data)
    head = _MAGIC + struct.pack("<Q", start_us - before * 20_000)
    appended = _several("perf_counter_postflight", "logger_sd_fsync: 12 events")
    flags = bytes(8) + bytes((_APPENDED,)) + bytes(7)
    at = len(head) + 3 + len(flags) + 24 + len(body)
    return head + _message("B", flags + struct.pack("<3Q", at, 0, 0)) + body + appended


def _definitions(boot_us: int) -> Iterable[bytes]:
    for text in _FORMATS:
        yield _message("F", text.encode())
    yield _information("char[3] sys_name", b"PX4")
    yield _information("char[10] ver_hw", b"PX4_FMU_V6")
    yield _information("uint32_t ver_sw_release", struct.pack("<I", 0x010E00FF))
    yield _information("int32_t time_ref_utc", struct.pack("<i", 0))
    yield _several("boot_console_output", "HW arch: PX4_FMU_V6C\n", "NuttX: Release 11.0.0\n")
    yield _parameter("int32_t EKF2_EV_CTRL", struct.pack("<i", 15))
    yield _parameter("float MPC_XY_CRUISE", struct.pack("<f", 4.0))
    yield _message("Q", bytes((1,)) + _keyed("float MPC_XY_CRUISE", struct.pack("<f", 5.0)))


def _local_position(t_us: int, ned_m: Vector, valid: bool) -> bytes:
    floats = dict.fromkeys(_POSITION_FLOATS, 0.0) | dict(zip("xyz", ned_m, strict=True)) | {"dist_bottom": float("nan")}
    packed = struct.pack("<3Q2d", t_us, t_us - 4_000, 0, float("nan"), float("nan"))
    packed += struct.pack(f"<{len(floats)}f", *floats.values()) + bytes(16)
    return packed + bytes((valid,) * 4) + bytes(len(_POSITION_BYTES) - 4)


def _esc_status(t_us: int, counter: int) -> bytes:
    report = struct.pack("<QifB7x", t_us, 8_200, 15.9, 1)
    return struct.pack("<QHB5x", t_us, counter & 0xFFFF, 2) + 2 * report


def _battery(t_us: int) -> bytes:
    return struct.pack("<Qffb", t_us, 15.8, float("inf"), 4)


def _subscription(instance: int, number: int, name: str) -> bytes:
    return _message("A", struct.pack("<BH", instance, number) + name.encode())


def _data(number: int, content: bytes) -> bytes:
    return _message("D", struct.pack("<H", number) + content)


def _information(key: str, value: bytes) -> bytes:
    return _message("I", _keyed(key, value))


def _several(key: str, *lines: str) -> bytes:
    """One value in several messages, each after the first continuing it."""
    return b"".join(
        _message("M", bytes((number > 0,)) + _keyed(f"char[{len(line)}] {key}", line.encode()))
        for number, line in enumerate(lines)
    )


def _parameter(key: str, value: bytes) -> bytes:
    return _message("P", _keyed(key, value))


def _keyed(key: str, value: bytes) -> bytes:
    return bytes((len(key),)) + key.encode() + value


def _message(kind: str, body: bytes) -> bytes:
    return struct.pack("<H", len(body)) + kind.encode() + body
