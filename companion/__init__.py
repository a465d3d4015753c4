"""The drone: decisions, edges, and one app that wires them."""

import os

# Before NumPy is loaded: threads of BLAS spin while they wait for each other, and in the control loop's process, which
# runs in real time, they would keep everything else of the machine from its cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
