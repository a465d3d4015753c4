"""Cursor on Target 2.0: one XML document an event (MITRE's Event-PUBLIC.xsd; details as ATAK shows them). Pure.

An event says what (`type`), how it is known (`how`), where (`point`, with circular and linear error in metres, 9999999
for what is not known), from when to when. Angles in details are compass degrees.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Final
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from companion.tak.geodesy import Place

UNKNOWN_M: Final = 9999999.0
DRONE, UNKNOWN_GROUND, ELLIPSE, SENSOR = "a-f-A-M-H-Q", "a-u-G", "u-d-c-e", "b-m-p-s-p-loc"
GPS, FUSED = "m-g", "m-f"
_95: Final = math.sqrt(5.991464547107979)
"""Semi-axes of the ellipse that holds 95 %, in deviations: chi-squared with two degrees of freedom."""
_NO_XML: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML document may hold: one of them in a name would cost whoever reads it all events."""
_RED: Final = "-65536"
_NO_FILL: Final = "0"

Detail = tuple[str, Mapping[str, str], str]
"""Element, attributes, text."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CotEvent:
    """One event. `ce_m` and `le_m` are 1 σ across and in height."""

    uid: str
    kind: str
    how: str
    place: Place
    ce_m: float = UNKNOWN_M
    le_m: float = UNKNOWN_M
    stale_s: float
    details: Sequence[Detail] = ()
    ellipse: Ellipse | None = None


@dataclass(frozen=True, slots=True)
class Ellipse:
    """Semi-axes [m], and the compass direction of the longer one [degrees]."""

    major_m: float
    minor_m: float
    angle_deg: float
    style: Mapping[str, str] = field(default_factory=lambda: {"strokeColor": _RED, "fillColor": _NO_FILL})


def ellipse_95(covariance_m2: npt.NDArray[np.float64]) -> Ellipse:
    """Of a place's covariance (2, 2) or larger in East and North."""
    values, vectors = np.linalg.eigh(np.asarray(covariance_m2, float)[:2, :2])
    minor_m, major_m = (_95 * math.sqrt(max(0.0, float(value))) for value in values)
    east, north = vectors[:, 1].tolist()
    return Ellipse(major_m, minor_m, math.degrees(math.atan2(east, north)) % 180.0)


def xml(event: CotEvent, now: datetime) -> bytes:
    """The document, UTF-8, in one line."""
    root = ElementTree.Element(
        "event",
        version="2.0",
        uid=event.uid,
        type=event.kind,
        how=event.how,
        time=_time(now),
        start=_time(now),
        stale=_time(now + timedelta(seconds=event.stale_s)),
    )
    place = event.place
    ElementTree.SubElement(
        root,
        "point",
        lat=f"{place.latitude_deg:.7f}",
        lon=f"{place.longitude_deg:.7f}",
        hae=_metres(place.hae_m),
        ce=_metres(event.ce_m),
        le=_metres(event.le_m),
    )
    detail = ElementTree.SubElement(root, "detail")
    for name, attributes, text in event.details:
        ElementTree.SubElement(detail, name, dict(attributes)).text = text or None
    if event.ellipse is not None:
        _add_ellipse(detail, event.ellipse)
    for element in root.iter():
        element.attrib.update({name: _NO_XML.sub("?", value) for name, value in element.attrib.items()})
        element.text = element.text and _NO_XML.sub("?", " ".join(element.text.splitlines()))
    document: bytes = ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return document.replace(b"\n", b"")


def sensor(azimuth_deg: float, width_deg: float, range_m: float) -> Detail:
    """A wedge about a compass direction."""
    return (
        "sensor",
        {
            "azimuth": f"{azimuth_deg % 360.0:.1f}",
            "fov": f"{min(360.0, max(1.0, width_deg)):.1f}",
            "range": f"{range_m:.0f}",
            "displayMagneticReference": "0",
            "fovRed": "1.0",
            "fovGreen": "0.0",
            "fovBlue": "0.0",
            "fovAlpha": "0.3",
        },
        "",
    )


def _add_ellipse(detail: ElementTree.Element, ellipse: Ellipse) -> None:
    shape = ElementTree.SubElement(detail, "shape")
    ElementTree.SubElement(
        shape,
        "ellipse",
        major=f"{ellipse.major_m:.2f}",
        minor=f"{ellipse.minor_m:.2f}",
        angle=f"{ellipse.angle_deg:.1f}",
    )
    for name, value in ellipse.style.items():
        ElementTree.SubElement(detail, name, value=value)


def _time(moment: datetime) -> str:
    return moment.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"


def _metres(value: float | None) -> str:
    known = value is not None and math.isfinite(value) and abs(value) < UNKNOWN_M
    return f"{value:.2f}" if known else f"{UNKNOWN_M:.1f}"
