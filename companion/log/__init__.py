"""Flight logs (MCAP): written while flying, read, mended, joined and exported afterwards.

Messages come in by the Recorder protocol of `core` (`recorder`, on a thread of its own: `parts` and `writer` are its
files, `records` and `foxglove` what messages become); `reader`, `scan` and `info` read, `repair`, `merge` and `export`
make files of files, `ulog` reads PX4's own log, `truth` and `truths` are what really was. Touches files alone; nothing
here decides.
"""
