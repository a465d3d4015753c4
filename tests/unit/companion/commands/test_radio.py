"""`companion radio`: what would be done to the card is printed, and done only where it is asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.commands import radio as module
from tests.log_commands import Run
from tests.paths import CONFIGS


class _Step:
    taken = 0

    def __str__(self) -> str:
        return "iw dev mon0 set channel 108 HT20"

    def take(self) -> None:
        _Step.taken += 1


def test_a_dry_run_prints_and_does_nothing(companion: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "steps", lambda config, system: [_Step(), _Step()])
    code, out, _ = companion("radio", "--config", CONFIGS / "uav.yaml", "--dry-run")
    assert (code, out) == (0, f"{_Step()}\n{_Step()}\n")
    assert _Step.taken == 0
    assert companion("radio", "--config", CONFIGS / "uav.yaml")[0] == 0
    assert _Step.taken == 2


def test_a_configuration_without_a_card_says_so(companion: Run, tmp_path: Path) -> None:
    text = (CONFIGS / "demo-uav.yaml").read_text()
    (tmp_path / "unix.yaml").write_text(text.replace("source: netlink", "source: unix"))
    code, out, _ = companion("radio", "--config", tmp_path / "unix.yaml", "--dry-run")
    assert (code, out) == (0, "csi.source is unix: there is no card to prepare\n")


def test_a_configuration_that_is_not_there_is_one_line(companion: Run, tmp_path: Path) -> None:
    code, _, err = companion("radio", "--config", tmp_path / "none.yaml")
    assert code == 2
    assert "no such configuration file" in err
