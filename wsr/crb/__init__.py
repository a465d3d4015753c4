"""The Cramer-Rao bound of a direction, and what is made of it: a path and a phase noise in, variances out.

`bound` (of one direction: `fim`, `crb`), `sphere` (of many directions at once), `informativeness` (one aperture,
online) and `angular_drift` (what errors of the displacement do to the peak). It knows plane waves and no channel
values; the bound of an estimate with its range is `wsr.uncertainty.bound`.
"""

from wsr.crb.bound import Crb, Phase, crb, fim

__all__ = ["Crb", "Phase", "crb", "fim"]
