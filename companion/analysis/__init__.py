"""Recorded runs and data sets: files of both ends and trajectories in, bearings and their errors out.

Reads files and logs, computes with `wsr`, returns results and terminal tables; it draws nothing, flies nothing and
opens no socket. What `sensing` makes in flight is built here from files by the same functions of `wsr`.
"""
