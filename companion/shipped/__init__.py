"""What goes with the program and is no program: example configurations and their schema, PX4's parameter files, the
units. The folders here are links to `configs/` and `systemd/` at the root; a wheel holds the files. Read only.
"""
