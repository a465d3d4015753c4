"""The streams of the log live to Foxglove, Lichtblick and what else speaks their protocol.

`server` is a process of its own that the service starts by module name: encoded messages come in on its standard
input, the library `foxglove-sdk` serves them, and what viewers subscribe to goes back. `front` lets in who knows the
word, where there is one. Nothing here knows the flight, and nothing of the flight waits for it.
"""
