"""`companion status` for a person: the card, the neighbours and the interfaces, each in a line."""

from __future__ import annotations

import asyncio
import sys
from asyncio.subprocess import PIPE, STDOUT
from pathlib import Path

import pytest

from companion.commands.control import radio_lines
from tests.control_socket import serving


def test_neighbours_show_their_state_and_what_was_refused() -> None:
    refused = {"bad_key": 3, "malformed": 0, "replay": 0, "duplicate_identity": 2, "impossible_jump": 0}
    neighbour = {
        "state": "tracked",
        "accepted": 82,
        "refused": refused,
        "pairing_rate": 0.97,
        "clock_offset_s": 38.44957,
        "clock_uncertainty_s": 0.0004,
        "round_trip_s": 0.0012,
    }
    unheard = neighbour | dict.fromkeys(("pairing_rate", "clock_offset_s", "clock_uncertainty_s", "round_trip_s"))
    unheard |= {"state": "unheard", "accepted": 0, "refused": dict.fromkeys(refused, 0)}
    health = {
        "radio": {"samples": 994, "lost": 4, "malformed": 1, "unknown_sender": 2, "no_sender": 0, "wide": 0},
        "neighbours": {"tx2": neighbour, "tx3": unheard},
        "link": {"unknown_sender": 5, "malformed": 0, "version": 1},
        "interfaces": {"wlan1": 2855.9},
        "lookalikes": [["tx2", "tx3"]],
    }
    assert list(radio_lines(health)) == [
        ("card", "994 packets of neighbours, 3 of others or unusable, 4 counted by the driver and never seen"),
        (
            "neighbour tx2",
            "tracked, 82 datagrams, 97 % of its packets paired, its clock +38.4496 s from ours, uncertain by 0.4 ms, "
            "round trip 1.2 ms, 3 refused: bad key, 2 refused: duplicate identity",
        ),
        ("neighbour tx3", "unheard, 0 datagrams"),
        ("strangers", "5 unknown sender, 0 malformed, 1 version"),
        ("sent at wlan1", "2.9 KB/s"),
        ("look alike", "tx2 and tx3: one transmitter behind both?"),
    ]


def test_a_service_without_health_says_nothing_of_it() -> None:
    assert list(radio_lines({})) == []


def test_what_the_network_lacks_is_told() -> None:
    told = dict(radio_lines({"network_problem": "interface robots is down", "link": {"unsent": 7, **_NONE}}))
    assert told["robots' network"] == "interface robots is down; 7 datagrams not sent"


_NONE = {"unknown_sender": 0, "malformed": 0, "version": 0}


async def _answers(command: str, target: str | None = None) -> dict[str, object]:
    if target == "gamma":
        refusal = "no robot has the name or id 'gamma'; expected one of alpha (2), beta (3)"
        return {"ok": False, "error": refusal, "vehicle": "system 1", "target": "alpha"}
    return {"ok": True, "error": "", "vehicle": "system 1, px4 1.16.1", "target": target or "alpha"}


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        ([], 0, "engaged: system 1, px4 1.16.1, to alpha\n"),
        (["--target", "beta"], 0, "engaged: system 1, px4 1.16.1, to beta\n"),
        (["--target", "gamma"], 1, "companion: engage refused: no robot has the name or id 'gamma'; expected one of "
         "alpha (2), beta (3)\n"),
    ],
)  # fmt: skip
async def test_a_robot_is_named_and_an_unknown_one_refused(
    tmp_path: Path, options: list[str], code: int, said: str
) -> None:
    path = tmp_path / "control.sock"
    async with serving(path, _answers):
        command = (sys.executable, "-m", "companion", "engage", "--socket", str(path), *options)
        ran = await asyncio.create_subprocess_exec(*command, stdout=PIPE, stderr=STDOUT)
        out, _ = await ran.communicate()
    assert (ran.returncode, out.decode()) == (code, said)
