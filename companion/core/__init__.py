"""The words every room shares: messages, clocks, the table of streams, the inputs of a log, the Recorder protocol, and
how one part's output reaches others (`output`). Only types and time: nothing here reads a file, opens a socket or
knows another room.
"""
