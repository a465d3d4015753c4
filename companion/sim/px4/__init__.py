"""The mock PX4 under one clock: `airframe` moves, `commander` decides modes, `link` speaks MAVLink.

MAVLink comes in and goes out over loopback UDP (`autopilot`, a process); tests give it orders
and get a `report`. It knows nothing of the companion.
"""
