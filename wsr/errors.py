"""The one refusal of this package."""

from __future__ import annotations


class ApertureError(ValueError):
    """Measurements that no bearing can be computed from; the message names the quantity, its value and the limit."""
