"""Where all robots of a team are, relative to this one, from everybody's raw bearings, ranges and displacements.

`tracks` keeps what each robot says of its own path, `factors` the residuals of one sighting, `smoother` the estimate
over the last minute, `estimate` who is placed where and how surely. `worker` is the process that computes it, `process`
the service's end of it, `gathering` what that process is told. Touches no socket but its pipe, and nothing that flies.
"""
