"""Who may command the vehicle, read from the source."""

from __future__ import annotations

import re
from pathlib import Path

import companion

_COMMANDS = ("arm", "takeoff", "request_offboard", "hold", "land", "return_home")


def test_a_set_point_has_one_way_out_and_it_leads_through_the_gate() -> None:
    """Read from the source: who else could send one would have to name it."""
    root = Path(companion.__file__).parent
    texts = {path.relative_to(root).as_posix(): path.read_text() for path in root.rglob("*.py")}
    texts = {name: text for name, text in texts.items() if not name.startswith("sim/")}
    assert {name for name, text in texts.items() if ".send_setpoint(" in text} == {
        "flight/loop.py",
        "autopilot/delegating.py",
    }
    flight = texts["flight/loop.py"]
    assert flight.count(".send_setpoint(") == 1 and re.findall(r"self\._send\((.*)\)", flight) == ["verdict.setpoint"]
    messages = re.compile(r"SET_(POSITION|ATTITUDE|ACTUATOR)\w*_TARGET|MANUAL_CONTROL|RC_CHANNELS_OVERRIDE")
    assert {name for name, text in texts.items() if messages.search(text)} == {"autopilot/mavsdk_edge.py"}
    plugins = {plugin for text in texts.values() for plugin in re.findall(r"mavsdk\.plugins\.(\w+)", text)}
    assert plugins == {"mavlink_direct"}, "the library's own offboard plugin repeats the last set point for ever"


_ABOUT_THE_FLIGHT = (
    "announcements",
    "camera_lead",
    "course",
    "engagement",
    "knowledge",
    "limits",
    "local_frame",
    "observer",
    "origin",
    "rc_switch",
    "records",
    "refusals",
    "situation",
    "status",
    "vehicle_feed",
    "wishes",
)


def test_what_the_loop_knows_is_asked_and_answers_commands_nothing() -> None:
    """Modules of the room that may name no command of the port, nor start one."""
    folder = Path(companion.__file__).parent / "flight"
    named = re.compile(rf"\.({'|'.join((*_COMMANDS, 'send_setpoint', 'start', 'leave_at_end'))})\(|FlightCommands")
    assert {path.stem for path in folder.glob("*.py") if named.search(path.read_text())} == {"loop", "commands"}
    assert set(_ABOUT_THE_FLIGHT) | {"__init__", "commands", "loop", "vio_forward"} == {
        path.stem for path in folder.glob("*.py")
    }
