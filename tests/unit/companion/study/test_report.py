"""What a study leaves behind: numbers in words, JSON without infinities, a page that needs nothing else."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from companion.study.report import shown, shown_ours, write_json, write_page
from companion.study.study import Finding, Outcome, Value

_OUTCOME = Outcome(
    study="drift", title="Drift <of> poses", figures=("Fig. 8",), seed=1, trials=3, elapsed_s=2.0,
    findings=[
        Finding(quantity="median <error>", ours=4.567, paper=7.6, unit="deg"),
        Finding(quantity="share", ours=50.0, unit="%", interval=(20.0, 80.0)),
    ],
    notes=["Poses & clocks."], rows=[{"a": math.inf}],
)  # fmt: skip


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (4.567, "deg", "4.57°"), (1234.5, "s", "1234 s"), (0.0123, "", "0.0123"), (math.inf, "deg", "infinite"),
        ("1 of 1", "%", "1 of 1"), (None, "deg", ""), (-5.0, "%", "-5 %"),
    ],
)  # fmt: skip
def test_a_number_is_shown_with_its_unit(value: Value, unit: str, text: str) -> None:
    assert shown(value, unit) == text


def test_a_share_has_its_interval() -> None:
    assert shown_ours(_OUTCOME.findings[1]) == "50 % (20-80)"
    assert shown_ours(_OUTCOME.findings[0]) == "4.57°"


def test_json_is_read_by_any_program(tmp_path: Path) -> None:
    write_json(tmp_path / "new" / "one.json", _OUTCOME)
    told = json.loads((tmp_path / "new" / "one.json").read_text())
    assert (told["study"], told["rows"]) == ("drift", [{"a": None}])
    write_json(tmp_path / "all.json", [_OUTCOME, _OUTCOME])
    assert len(json.loads((tmp_path / "all.json").read_text())) == 2


def test_the_page_holds_its_pictures_and_names_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / "drift.png").write_bytes(b"\x89PNG picture")
    write_page(tmp_path / "r.html", [_OUTCOME], {"drift": tmp_path / "drift.png"}, {"vio": "has no recordings <here>"})
    page = (tmp_path / "r.html").read_text()
    assert page.count("data:image/png;base64,") == 1
    assert "http" not in page
    for text in ("median &lt;error&gt;", "4.57°", "7.6°", "50 % (20-80)", "Poses &amp; clocks.", "recordings &lt;here"):
        assert text in page
