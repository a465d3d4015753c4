"""The two roles of the service, wired: `uav` and `beacon`, on the inputs they share (`node`).

Opens what a configuration names (`inputs`) and connects rooms; it decides nothing itself.
"""
