"""Recorded runs and data sets: files of both ends and trajectories in, bearings and their errors out.

`runs` finds the files, `trajectories` and `exchanges` read them, `scene` joins them, `bearings` estimates, `evaluation`
compares with the truth, `imported` does the same from logs; `result` is what comes out and `summary` sums it up. Reads
files and logs and computes with `wsr`; it draws nothing, prints nothing, flies nothing and opens no socket. What
`sensing` makes in flight is built here from files by the same functions of `wsr`.
"""
