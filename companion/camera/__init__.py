"""The camera that sees a tag on the robot that is flown to: what it saw (`sighting`), where that is (`place`), and the
process that looks (`reader`, with `images` and `detector`), which alone imports OpenCV. Images come in there and
`TagFrame`s leave; the service takes them at the other end of a socket pair (`source`). Judges nothing and commands
nothing: what a sighting is worth is decided in `guidance`.
"""
