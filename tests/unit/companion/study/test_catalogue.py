"""Every study can be found and planned."""

from __future__ import annotations

import pytest

from companion.study.catalogue import MODULES, study
from companion.study.study import Settings
from tests.paths import DATA


@pytest.mark.parametrize("name", list(MODULES))
def test_every_study_names_its_figures_and_plans_trials(name: str) -> None:
    one = study(name)
    assert one.name == name
    assert one.figures
    if name == "vio" and not DATA.is_dir():
        pytest.skip(f"{DATA} is not there")
    assert one.plan(Settings(2, DATA))
