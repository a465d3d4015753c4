"""What a tracker that has something wrong tells in place of the true pose."""

from __future__ import annotations

import math
from dataclasses import replace

from companion.core.messages import Pose

_CONFIDENCE = {"failed": 0, "low": 1}


class FaultyTracker:
    """Keeps by how much its poses have jumped, and the last one, which a frozen tracker tells again."""

    def __init__(self) -> None:
        self._offset_m = 0.0
        self._last: Pose | None = None

    def jump(self, east_m: float) -> None:
        self._offset_m += east_m

    def pose(self, true: Pose, word: str) -> Pose:
        """With the fault `word`; empty for none."""
        if word == "frozen" and self._last is not None:
            told = replace(self._last, t_mono_ns=true.t_mono_ns, confidence=3)
        else:
            x, y, z = true.p_enu_m
            told = replace(
                true,
                p_enu_m=(math.nan if word == "nan" else x + self._offset_m, y, z),
                confidence=_CONFIDENCE.get(word, true.confidence),
            )
        self._last = told
        return told
