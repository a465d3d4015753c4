"""The operating system's odds and ends: child processes, datagram sockets, systemd's notices, the control socket.

Knows nothing of radios, poses or flight.
"""
