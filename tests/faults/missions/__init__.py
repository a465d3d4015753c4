"""Whole missions under seeded random faults at virtual time, judged by the promises of docs/safety.md.

Real: flight loop, mission, conditions, preflight, gate, guidance, tracker, SAR iterations, pose health, and the edge
with its telemetry. Not real: sockets and the MAVLink library, radio, apertures and estimator, whose answers are drawn;
with `--real` radio, cameras, window, the worker's computation, estimator and clock relation are computed too.

Left out, for ten thousands of missions: the vehicle tells its place at 10 or 20 Hz (the edge asks for 50), attitude,
TIMESYNC and estimator at 2 Hz, RC only where a switch is configured, odometry and status never; poses come at 30 to 40
Hz; the edge looks every 50 ms, not 10, whether a command has come true, and reads nothing of the host for its own
status; nothing is written to a log. A mission ends 4 s after the last flight, when nobody is to engage again.
`python -m tests.faults.missions --help` flies them.
"""
