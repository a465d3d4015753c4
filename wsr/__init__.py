"""Wireless signal as a sensor: direction of a transmitter from packet channels and the receiver's own displacement.

Pure maths, numpy in and numpy out; no files, sockets, clocks or logging. World axes are East, North, Up; azimuth runs
counter-clockwise from East, the polar angle from Up, both in radians. In the order of use: `channel` (one complex value
per packet, pairing of forward and reverse), `displacement` (positions at packet times), `aperture` (the checked input),
`estimators` (the ways to estimate, by name), `aoa` (what an estimate says), and under them `kernel`,
`profile`, `peaks` and `crb` (bounds, informativeness, angular drift); `geometry` and `frames` hold rotations and axes,
`errors` the one refusal, `ApertureError`.
"""
