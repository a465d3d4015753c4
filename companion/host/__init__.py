"""The operating system's odds and ends: child processes and how they end (`child`, `pool`, `fed_process`, `ending`),
sockets that are emptied together (`coalescing`, `unix_datagram`), files that are replaced whole or have one writer
(`whole_file`, `sole_user`), priority, systemd's notices (`notify`), the control socket and its token. Knows nothing of
radios, poses or flight.
"""
