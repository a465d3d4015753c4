"""What may not go wrong, as pure functions: the gate before every set point, the preflight's list, the fault table.

No I/O; `document` writes the parts of docs/mission.md and docs/vehicle.md that are made from code.
"""
