"""All studies by name. Each is imported only when asked for."""

from __future__ import annotations

import importlib
from typing import Any, Final

from companion.study.study import Study

RENDEZVOUS: Final = "rendezvous"
MODULES: Final = {
    "crb": "crb_geometries",
    "geometry": "geometry_errors",
    "drift": "drift",
    "moving-ends": "moving_ends",
    "vio": "vio",
    RENDEZVOUS: "rendezvous",
    "packets": "packets",
    "team": "team",
    "bandwidth": "bandwidth",
}


def study(name: str) -> Study[Any, Any]:
    """Raises KeyError for a name that is not in `MODULES`."""
    found = importlib.import_module(f"companion.study.{MODULES[name]}").STUDY
    assert isinstance(found, Study)
    return found
