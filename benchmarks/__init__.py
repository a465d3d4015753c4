"""Measurements, run by `make bench`: ratios against a named baseline of the same run.

What ours is compared with stands here too, and tests use it: `far_field` (plane waves alone, `refinement` of its peak),
`oracle` (a profile by its definition), `sliding` (running sums of a window).
"""

import os

# One thread for everybody, as in the worker process; set before NumPy is loaded.
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
