"""The Cramer-Rao bound of a direction, and what is made of it.

`bound` (of one direction: `fim`, `crb`), `sphere` (of many directions at once), `focused` (azimuth, polar angle and
range of a near source), `closed_forms` (helix, circle, line), `informativeness` (one aperture, online) and
`angular_drift` (what errors of the displacement do to the peak).
"""

from wsr.crb.bound import Crb, Phase, crb, fim

__all__ = ["Crb", "Phase", "crb", "fim"]
