"""The other robots' datagrams: bytes in, poses and reverse channels of each neighbour out, and how far to trust them.

`link` is the socket, `wire` and `columns` are the bytes; `receiver` authenticates and files what arrives with its
`neighbour`, which judges it (`session`), relates the clocks (`clock_relation`) and pairs packets (`pairing`); `sender`
makes our own datagrams. Touches the UDP socket, the files of keys (`keys`) and the file of boots (`boots`); no card, no
pose source.
"""
