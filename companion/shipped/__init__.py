"""What goes with the program and is no program: example configurations and their schema, PX4's parameter files, the
units, the pinned requirements. What stands here links to `configs/`, `systemd/` and `requirements.txt` at the root; a
wheel holds the files. Read only.
"""
