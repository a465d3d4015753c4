"""PX4's events about its arming checks: numbers, names, and the modes that each is about.

PX4 numbers an event by a hash of its name, and sends the number alone. The names are those of 1.16 that a multicopter
may meet; what another version adds is shown by its number.
"""

from __future__ import annotations

from typing import Final

from companion.core.messages import FlightMode

_NAMES: Final = """
accel_missing accel_no_data accel_not_calibrated armable_configuration avionics_power_high avionics_power_low
avionics_power_missing baro_missing baro_no_data battery_critical battery_disconnected battery_emergency battery_fault
battery_low battery_missing battery_unhealthy cpuload_too_high distance_sensor_invalid distance_sensor_missing
escs_fault escs_offline escs_telem_missing estimator_gnss_fault estimator_gps_fix_too_low estimator_gps_generic
estimator_gps_hor_pos_drift_too_high estimator_gps_hor_pos_err_too_high estimator_gps_hor_speed_drift_too_high
estimator_gps_not_fusing estimator_gps_num_sats_too_low estimator_gps_pdop_too_high estimator_gps_speed_acc_too_low
estimator_gps_vert_pos_drift_too_high estimator_gps_vert_pos_err_too_high estimator_gps_vert_speed_drift_too_high
estimator_heading_not_stable estimator_hgt_not_stable estimator_high_accel_bias estimator_high_gyro_bias
estimator_hor_pos_not_stable estimator_hor_vel_not_stable estimator_low_position_accuracy estimator_mag_fault
estimator_mag_interference estimator_missing_data estimator_vert_vel_not_stable failure_detector_alt
failure_detector_arm_esc failure_detector_ext failure_detector_imbalanced_prop failure_detector_motor
failure_detector_pitch failure_detector_roll gf_no_home gf_violation_custom_gf gf_violation_max_alt
gf_violation_max_hor_dist gyro_missing gyro_no_data gyro_not_calibrated hardfault_present imu_accel_inconsistent
imu_gyro_inconsistent mag_consistency mag_fault mag_missing mag_no_data mag_not_calibrated mag_sys_has_mag_missing
man_control_kill_engaged man_control_rtl_engaged missing_cpuload missing_fmu_sdcard missing_system_power
modes_angular_velocity modes_attitude modes_cannot_takeoff modes_global_pos modes_home_position modes_local_alt
modes_local_pos modes_manual_control modes_mission modes_offboard_signal optical_flow_sensor_invalid
optical_sensor_missing parachute_missing parachute_unhealthy power_oc_hipower power_oc_periph ram_usage_too_high
rc_dl_no_dllink system_arm_auth_failed system_flight_term_active system_no_global_pos system_no_home_pos
system_safety_button system_usb_connected
"""
_NAVIGATION_STATES: Final = {
    FlightMode.MISSION: 1 << 3,
    FlightMode.HOLD: 1 << 4,
    FlightMode.RETURN: 1 << 5,
    FlightMode.OFFBOARD: 1 << 14,
    FlightMode.TAKEOFF: 1 << 17,
    FlightMode.LAND: 1 << 18,
    FlightMode.MANUAL: 1 << 0 | 1 << 1 | 1 << 2 | 1 << 10 | 1 << 15,
}
"""Bits of an event's first argument."""
_OF_PX4: Final = 1 << 24
"""The sender, above the 24 bits of the hash."""


def event_number(name: str) -> int:
    """FNV-1a of 32 bits, of which 24 are kept."""
    value = 0x811C9DC5
    for byte in name.encode():
        value = (value ^ byte) * 0x1000193 & 0xFFFFFFFF
    return value & 0xFFFFFF | _OF_PX4


BEGIN: Final = event_number("commander_arming_check_summary")
END: Final = event_number("commander_health_summary")
"""A report begins and ends by these; what comes between is one check each."""
_WORDS: Final = {event_number(f"check_{name}"): name.replace("_", " ") for name in _NAMES.split()}


def words(number: int) -> str:
    """What a check says, by its name."""
    return _WORDS.get(number, f"PX4's event {number}")


def concerns(modes: int, mode: FlightMode | None) -> bool:
    """Whether a check is about `mode`; of a mode that is not known, whether it is about any."""
    return bool(modes & _NAVIGATION_STATES.get(mode, 0xFFFFFFFF)) if mode is not None else bool(modes)
