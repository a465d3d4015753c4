"""Whole missions under seeded random faults at virtual time, judged by the promises of docs/safety.md.

Real: flight loop, mission, conditions, preflight, gate, guidance, tracker, SAR iterations, pose health, and the edge
with its telemetry. Not real: sockets and the MAVLink library, radio, apertures and estimator, whose answers are drawn.
`python -m tests.faults.missions --help` flies them.
"""
