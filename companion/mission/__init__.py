"""The mission as a pure state machine: telemetry and ages become events (`conditions`), events become states and
actions (`table`). No clock, no I/O: everything is an argument, and what an action means is not known here.
"""
