"""Where to fly: bearings in; where the target may be (`targets`, of a `tracker` for each robot by `likelihood`,
`loudness` and `witnesses`) and the set points of one continuous path there (`approach`, by `steering` and `motion`)
out. Pure of I/O; takes bearings from `sensing` and the fence from `safety`, and commands nothing.
"""
