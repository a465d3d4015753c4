"""What of a SAR iteration goes to the others: the bearing as it was measured."""

from __future__ import annotations

import math

from companion.neighbours.sightings import Sighting
from companion.sensing.records import Iteration


def sighting_of(iteration: Iteration) -> Sighting | None:
    """None where nothing was measured, or nothing new. What is as wide as all around says nothing, and a deviation that
    the datagram's row cannot hold would have the whole datagram refused."""
    estimate = iteration.estimate
    if estimate is None or not estimate.azimuth_observable or not estimate.azimuth_std_rad < math.pi:
        return None
    return Sighting(
        target=iteration.peer,
        number=iteration.number & 0xFFFF,
        t_ns=iteration.reference_ns,
        azimuth_rad=estimate.azimuth_rad,
        azimuth_std_rad=estimate.azimuth_std_rad,
        polar_rad=estimate.polar_rad,
        polar_std_rad=estimate.polar_std_rad if estimate.polar_observable else math.inf,
        range_m=estimate.range_m,
        range_std_m=estimate.range_std_m,
        reliability=estimate.reliability,
        fresh=iteration.fresh,
    )
