"""Which version runs, installed or from its sources alone."""

from __future__ import annotations

import importlib.metadata
import re

import pytest

from companion.core.version import version


def test_it_is_the_installed_one() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+", version())


def test_sources_that_were_not_installed_have_none(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(name: str) -> str:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", none)
    assert version() == "not installed"
