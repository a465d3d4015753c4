"""Measurements, run by `make bench`: ratios against a named baseline of the same run."""

import os

# One thread for everybody, as in the worker process; set before NumPy is loaded.
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
