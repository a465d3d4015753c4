"""A reader of Cursor on Target events that knows nothing of who wrote them: the fields of MITRE's Event-PUBLIC.xsd."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime
from xml.etree import ElementTree

_REQUIRED = {"version", "uid", "type", "how", "time", "start", "stale"}
_OPTIONAL = {"access", "qos", "opex"}
_KIND = re.compile(r"\w+(-\w+)*(;[^;]*)?")
_HOW = re.compile(r"\w(-\w+)*")
_TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?Z")
_DECIMAL = re.compile(r"-?\d+(\.\d+)?")


@dataclass(frozen=True, kw_only=True)
class Cot:
    """One event as it was read."""

    uid: str
    kind: str
    how: str
    time: datetime
    stale: datetime
    point: dict[str, float]
    detail: ElementTree.Element

    def of(self, name: str) -> dict[str, str]:
        """Attributes of an element of the detail; fails where there is none."""
        found = self.detail.find(f".//{name}")
        assert found is not None, name
        return dict(found.attrib)


def read_cot(data: bytes) -> Cot:
    """Fails on whatever the schema does not permit."""
    root = ElementTree.fromstring(data)
    assert root.tag == "event" and _REQUIRED <= set(root.keys()) <= _REQUIRED | _OPTIONAL
    assert root.get("version") == "2.0" and root.get("uid")
    assert _KIND.fullmatch(root.get("type", "")) and _HOW.fullmatch(root.get("how", ""))
    times = [root.get(name, "") for name in ("time", "start", "stale")]
    assert all(_TIME.fullmatch(time) for time in times), times
    time, start, stale = (datetime.fromisoformat(time) for time in times)
    assert time == start < stale
    assert [child.tag for child in root] == ["point", "detail"]
    point = root[0].attrib
    assert set(point) == {"lat", "lon", "hae", "ce", "le"}
    assert all(_DECIMAL.fullmatch(value) for value in point.values()), point
    values = {name: float(value) for name, value in point.items()}
    assert -90 <= values["lat"] <= 90 and -180 <= values["lon"] <= 180
    assert values["ce"] >= 0 and values["le"] >= 0
    return Cot(
        uid=root.attrib["uid"],
        kind=root.attrib["type"],
        how=root.attrib["how"],
        time=time,
        stale=stale,
        point=values,
        detail=root[1],
    )
