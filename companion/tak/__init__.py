"""What TAK shows of the robot: Cursor on Target events, by a process of its own.

`geodesy` puts local places on the Earth, `events` makes the XML, `picture` keeps what a feed says and decides what is
told, `links` are multicast and TLS, `sender` is the process. Touches the network of the team and the files of its
certificates; nothing comes back from there to the service.
"""
