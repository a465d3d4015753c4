"""What stands where hardware would: the world with its radio and cameras, the mock autopilot, the demo's stage.

A `scenario` and a seed come in; CSI records, poses and telemetry go out by the sockets that the service reads, and the
truth into a log of its own. `world` and `px4.autopilot` are processes; `draws`, `propagation`, `trajectory`, `radio`
and `vio` are pure. Nothing here is part of the service, which knows nothing of it.
"""
