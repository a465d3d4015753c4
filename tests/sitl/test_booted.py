"""The units under a systemd that was booted for them: ready, judged, watched, upgraded and stopped as they say."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from tests.booted_root import booted_root, why_not
from tests.clean_root import SITE, CleanRoot
from tests.paths import ROOT

pytestmark = [pytest.mark.long, pytest.mark.skipif(bool(why_not()), reason=why_not() or "-")]
_MAKE = f"make -s DEPENDENCIES={SITE}"
_PYTHON = "/opt/companion/current/bin/python"
_STAGE = f"cd /srv && {_PYTHON} {ROOT}/tests/sitl/staged.py"
_STOP_S = 2.0


@pytest.fixture(scope="module")
def root() -> Iterator[CleanRoot]:
    with booted_root() as machine:
        assert "1.0 runs" in machine.run(f"{_MAKE} install VERSION=1.0 ROLE=uav")
        machine.run("useradd --no-create-home --groups companion pilot && useradd --no-create-home stranger")
        yield machine


def _show(root: CleanRoot, *keys: str, unit: str = "companion") -> list[str]:
    said = root.run(f"systemctl show {unit} {' '.join(f'-p {key}' for key in keys)}")
    values = dict(line.split("=", 1) for line in said.splitlines())
    return [values[key] for key in keys]


def _until(root: CleanRoot, command: str, why: str) -> None:
    root.run(f"for i in $(seq 120); do {command} && exit 0; sleep 1; done; {why}; exit 1")


def _pid(root: CleanRoot) -> int:
    return int(_show(root, "MainPID")[0])


def test_a_wrong_configuration_is_said_once_and_not_tried_again(root: CleanRoot) -> None:
    root.run("cp /etc/companion/companion.yaml /kept; echo 'rolle: uav' >> /etc/companion/companion.yaml")
    root.run("systemctl start companion", code=1)
    time.sleep(2.5)
    assert _show(root, "ActiveState", "ExecMainStatus", "NRestarts") == ["failed", "2", "0"]
    assert "rolle: unknown key; did you mean role?" in root.run("journalctl --unit companion --no-pager")
    root.run("cp /kept /etc/companion/companion.yaml")


def test_a_network_that_is_missing_is_waited_for(root: CleanRoot) -> None:
    root.run("companion keygen --owner companion /etc/companion/beacon.key")
    root.run("systemctl start companion", code=1)
    time.sleep(4.0)
    assert int(_show(root, "NRestarts")[0]) >= 1
    assert "expected the broadcast address" in root.run("journalctl --unit companion --no-pager")
    root.run("systemctl stop companion")


def test_the_service_is_ready_as_its_user_with_one_capability(root: CleanRoot) -> None:
    root.run(_STAGE)
    root.run("companion-setup configure && systemctl start companion")
    assert _show(root, "ActiveState", "SubState") == ["active", "running"], "start returns when it is ready"
    status = dict(line.split(":\t", 1) for line in root.run(f"cat /proc/{_pid(root)}/status").splitlines())
    user = root.run("id --user companion").strip()
    assert status["Uid"].split() == [user] * 4 and status["NoNewPrivs"] == "1" and status["Seccomp"] == "2"
    net_admin = f"{1 << 12:016x}"
    assert {status[kind] for kind in ("CapEff", "CapPrm", "CapAmb", "CapBnd")} == {net_admin}
    assert set(status["Groups"].split()) == set(root.run("getent group companion dialout | cut -d: -f3").split())
    assert _show(root, "Result", "ExecMainStatus", unit="companion-radio") == ["success", "0"]

    pilot = "setpriv --reuid pilot --regid pilot --init-groups"
    assert "idle" in root.run(f"{pilot} companion status")
    assert "permission denied" in root.run(f"{pilot} companion engage", code=1)
    root.run("setpriv --reuid stranger --regid stranger --init-groups companion status", code=1)
    assert "FAILED" not in root.run("companion doctor system")


def test_what_the_unit_allows_is_what_the_process_has(root: CleanRoot) -> None:
    allowed = _show(root, "LimitRTPRIO", "LimitNICE", "MemoryMax", "OOMScoreAdjust")
    assert allowed == ["10", "30", f"{1536 << 20}", "-500"], "a niceness of -10 is 30 of setrlimit(2)"
    pid = _pid(root)
    if root.run("prlimit --rtprio=10:10 true > /dev/null 2>&1; echo $?") == "0\n":  # else nobody here may raise a limit
        rows = root.run(f"cat /proc/{pid}/limits").splitlines()
        limits = {row[:26].strip(): row[26:].split()[:2] for row in rows}
        assert limits["Max realtime priority"] == ["10", "10"] and limits["Max nice priority"] == ["30", "30"]
        assert root.run(f"cat /proc/{pid}/oom_score_adj") == "-500\n"
        assert "SCHED_RR" in root.run(f"chrt --pid {pid}")
    if "memory" in root.run("cat /sys/fs/cgroup/cgroup.controllers").split():
        (group,) = _show(root, "ControlGroup")
        assert root.run(f"cat /sys/fs/cgroup{group}/memory.max") == f"{1536 << 20}\n"


def test_what_stands_still_is_replaced_and_idle(root: CleanRoot) -> None:
    before = _pid(root)
    root.run(f"kill -STOP {before}")
    deadline_s = time.monotonic() + 30.0
    while _pid(root) in (0, before) or _show(root, "SubState") != ["running"]:
        assert time.monotonic() < deadline_s, root.run("journalctl --unit companion --no-pager | tail -5")
        time.sleep(0.2)
    assert "idle" in root.run("companion status")


def test_an_upgrade_and_a_way_back_restart_what_runs(root: CleanRoot) -> None:
    running = _pid(root)
    root.run(f"{_MAKE} install VERSION=1.1")
    upgraded = _pid(root)
    assert upgraded not in (0, running) and root.run("readlink /opt/companion/current") == "1.1\n"
    root.run("companion-setup rollback")
    assert _pid(root) not in (0, upgraded) and root.run("readlink /opt/companion/current") == "1.0\n"
    assert _show(root, "ActiveState") == ["active"]


def test_a_beacon_takes_the_place_of_the_other_role(root: CleanRoot) -> None:
    root.run("cp -p /etc/companion/companion.yaml /kept.uav")
    root.run("cp -p /srv/stage/beacon-as-installed.yaml /etc/companion/companion.yaml")
    root.run("systemctl start companion-beacon || { journalctl --no-pager -u companion-beacon | tail -5; exit 1; }")
    assert _show(root, "ActiveState", unit="companion-beacon") == ["active"]
    assert _show(root, "ActiveState") == ["inactive"], "they would share sockets"
    root.run("systemctl stop companion-beacon && cp -p /kept.uav /etc/companion/companion.yaml")


def test_it_flies_refuses_to_be_changed_and_hands_over_when_it_is_stopped(root: CleanRoot) -> None:
    # Nothing flies yet, so the compiler need not stand back.
    root.run("printf '#!/bin/sh\\nexec \"$@\"\\n' > /usr/local/bin/nice && chmod +x /usr/local/bin/nice")
    root.run("companion-setup warm-up && rm /usr/local/bin/nice")
    root.run("rm -f /var/log/companion/*; systemctl restart companion")
    root.run(f"cd /srv && nice {_PYTHON} -m companion.sim.world --scenario stage/scenario.json > world.txt 2>&1 &")
    root.run(f"cd /srv && nice {_PYTHON} -m companion.sim.px4.autopilot $(cat stage/px4) > px4.txt 2>&1 &")
    root.run(f"cd /srv && {_PYTHON} -m companion run --config stage/beacon.yaml > beacon.txt 2>&1 &")
    _until(root, "companion engage > /engaged.txt 2>&1", "cat /engaged.txt")
    _until(root, "companion status --json | grep -q '\"in_air\": true'", "companion status")
    for change in ("configure", "activate 1.0", "remove"):
        assert "land and disarm it first" in root.run(f"companion-setup {change}", code=1)
    begun_s = time.monotonic()
    root.run("systemctl stop companion")
    took_s = time.monotonic() - begun_s
    print(f"stopped in flight after {took_s:.2f} s")
    assert took_s < _STOP_S and _show(root, "Result", "ExecMainStatus") == ["success", "0"]
    assert "stopped on request" in root.run("journalctl --identifier companion --no-pager | tail -1")
    assert ", whole" in root.run("companion log info /var/log/companion/log.mcap")
    root.run("ls /run/companion", code=2)
    assert "hold" in root.run(f"cd /srv && {_PYTHON} {ROOT}/tests/sitl/staged.py --mode").lower()
