"""From packets to bearings: the window of paired packets, the SAR iterations cut from it, and the AOA worker that
computes them. Samples, poses, neighbours and the worker's answers come in; iterations leave, recorded. Touches the
worker process and nothing else outside.
"""
