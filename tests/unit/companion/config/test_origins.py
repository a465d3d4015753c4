"""Where each value of a configuration came from."""

from __future__ import annotations

from companion.config.document import read_document
from companion.config.file import config_of
from companion.config.origins import origins
from tests.paths import CONFIGS


def test_each_value_has_its_line_or_is_a_default() -> None:
    text = (CONFIGS / "demo-uav.yaml").read_text()
    found = {one.key: one for one in origins(config_of(read_document(text, "x"), "x"), text)}
    lines = text.splitlines()
    for key, word in (("csi.channel", "108"), ("peers[0].mac", "00:21:6A"), ("gate.fence_radius_m", "35")):
        line = found[key].line
        assert line is not None and word in lines[line - 1]
    assert found["gate.max_speed_m_s"].line is None and found["gate.max_speed_m_s"].value == 1.0
    assert (found["pose.lost_s"].value, found["pose.lost_s"].why) == (3.0, "without GPS")
    assert (found["mission.target"].value, found["mission.target"].why) == (2, "the first of peers")
