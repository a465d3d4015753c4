"""Flight logs (MCAP): written while flying, read, mended, joined and exported afterwards.

Messages come in by the Recorder protocol of `core`; files go out, on a thread of their own. Nothing here decides.
"""
