"""The other robots' datagrams: bytes in, poses and reverse channels of each neighbour out, and how far to trust them.

Also our own datagrams on their way out. Touches the UDP socket (`link`), the keys and the file of boots; no card, no
pose source.
"""
