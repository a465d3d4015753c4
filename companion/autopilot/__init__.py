"""The vehicle's edge: one protocol (`port`), MAVSDK behind it, and what may stand before it (`delegating`, `silent`,
`snapshot`). Telemetry comes in as snapshots in ENU; set points, commands and odometry go out. NED, MAVLink and the
library's traps end here; nothing here decides.
"""
