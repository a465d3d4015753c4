"""Which version of this program runs."""

from __future__ import annotations

import importlib.metadata


def version() -> str:
    """As it was installed; from sources that were not, it is not known."""
    try:
        return importlib.metadata.version("wsr-companion")
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
