"""The one place that may command the vehicle. Poses, neighbours, iterations and the autopilot's telemetry come in; set
points leave by `loop` through the gate, mode commands by `commands`, poses for the autopilot's estimator by
`vio_forward`, the origin of a vehicle on the ground that has none by `origin`, and nothing else leaves but records.
Where the mission stands (`course`), what is known of the target (`knowledge`), what the conditions look at
(`situation`), what a person asks (`wishes`, after `engagement` has looked) and is told (`status`) command nothing.
"""
