"""Where to fly: bearings in, the target's place and the legs towards it out.

Pure of I/O; asks `safety` for the fence and `sensing` for the path flown, and commands nothing.
"""
