"""A flight as pictures in a browser, while it happens, in a replay, or scrubbed in a report.

`server` is a process of its own that the service and a replay start by module name; a feed of messages comes in on its
standard input, HTTP goes out. `model` keeps what they say, `parts` makes of each message what the pictures need,
`health` says what is wrong and what to do, `next_step` what comes next, `metrics` the same for Prometheus, `access` who
may look; `assets` draw in the browser. Nothing here knows the flight, and nothing of the flight waits for it.
"""
