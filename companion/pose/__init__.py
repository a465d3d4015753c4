"""Where poses come from: one interface (`port`), the sources behind it, and what judges them and turns them to North
before anybody uses them (`intake`). Datagrams, motion capture, the autopilot's odometry and files come in, `Pose` in
ENU leaves. Starts and replaces the camera's reader process, whose part (`t265_reader`, `wire`) stands alone on an older
Python: nothing is imported here.
"""
