"""The companion of a drone that finds another robot: CSI, poses, datagrams and telemetry come in, set points and logs
go out. `cli` starts a command, `app` the service. Every folder is a room that says what it may touch;
docs/architecture.md has their order, which `make check` keeps. Nothing of ours is imported here: the camera's reader
goes through it.
"""

import os

__version__ = "0.2.0"
"""The only place that states it: pyproject.toml, the logs and the installer read it here."""

# Before NumPy is loaded: threads of BLAS spin while they wait for each other, and in the control loop's process, which
# runs in real time, they would keep everything else of the machine from its cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
