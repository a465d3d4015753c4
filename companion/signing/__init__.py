"""A vehicle that demands MAVLink 2 message signing, which the library between us and it cannot do.

`relay` is a process of its own between the line and MAVSDK's port, made of `lines` (its two ends, and how old what
waits there is), `frames` (signature and replay window, by pymavlink) and `book` (the windows on disk). `autopilot`
keeps it running and says in words what is wrong with what it counts. Nothing here decides or commands.
"""
