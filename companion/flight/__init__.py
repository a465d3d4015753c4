"""The one place that may command the vehicle: the 20 Hz loop, its commands, and who may engage.

Bearings, poses, neighbours and the autopilot's telemetry come in; set points leave by the gate alone, mode commands by
`commands` alone. What the loop knows, answers and is asked (`knowledge`, `status`, `wishes`) commands nothing.
"""
