"""The mission as a pure state machine: telemetry becomes events (`conditions`), events states and actions (`table`).

No clock, no I/O: everything is an argument.
"""
