"""Which messages the autopilot is asked for, by number, and how often: microseconds between two."""

from __future__ import annotations

from typing import Final

ALWAYS_US: Final = {
    32: 20_000,  # LOCAL_POSITION_NED
    30: 50_000,  # ATTITUDE
    436: 50_000,  # CURRENT_MODE: sent on each change of mode, while HEARTBEAT stays at 1 Hz
    245: 200_000,  # EXTENDED_SYS_STATE
    147: 1_000_000,  # BATTERY_STATUS
    1: 500_000,  # SYS_STATUS: whether it can arm
    230: 500_000,  # ESTIMATOR_STATUS
    65: 200_000,  # RC_CHANNELS
    331: 50_000,  # ODOMETRY: announces resets of the estimate
}
DISARMED_US: Final = {32: 50_000}
"""As often as the control loop looks: a vehicle that nobody has armed waits, and each message wakes two threads."""
ODOMETRY_US: Final = {331: 20_000}
"""Where it is also our source of poses."""
GPS_US: Final = {24: 200_000}
"""GPS_RAW_INT."""
