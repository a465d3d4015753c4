"""Where to fly: bearings in; the target's place, legs towards it and the set points along them out. Pure of I/O; takes
the fence from `safety`, begins and ends the iterations of `sensing` with its legs, and commands nothing.
"""
