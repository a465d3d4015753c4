"""A tag as the camera's process tells of it, seen well."""

from __future__ import annotations

from companion.camera.sighting import Tag

TAG = Tag(
    id=7,
    hamming=0,
    margin=0.8,
    contrast=0.6,
    p_camera_m=(0.1, 0.2, 3.0),
    covariance_m2=((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 4e-4)),
    error_px=0.05,
    other_p_camera_m=(0.1, 0.2, 3.01),
    other_error_px=1.5,
)
