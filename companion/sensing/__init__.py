"""From packets to bearings: the window of paired packets, SAR iterations cut from it, the AOA worker process.

Samples, poses and neighbours come in, iterations leave. Touches the worker process and nothing else outside.
"""
