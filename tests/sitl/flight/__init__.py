"""The whole service against the mock autopilot: the flight rows of the fault table, one cast for all modules.

Each test takes the vehicle as it finds it (engaged or not, in the air or not) and leaves it to the next. FC is the mock
autopilot, which counts what it receives by the kernel's own time stamps. `make faults` runs the long counts, in parts.
"""
