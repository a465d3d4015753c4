"""Measurements, run by `make bench`: ratios against a named baseline of the same run."""
