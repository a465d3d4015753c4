"""Installed, upgraded, rolled back and removed in a clean root: by make and as a Debian package."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion import __version__
from companion.sim.stage import free_udp_port
from tests.clean_root import SITE, CleanRoot, clean_root, why_not

pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not() or "-")
_MAKE = f"make -s DEPENDENCIES={SITE}"
_MISSING = {"card", "camera", "reader", "vehicle"}
_CONFIGURATION = "cd /etc/companion && for one in *.yaml *.key; do stat -c '%A %U %G' $one; sha256sum $one; done"
_NEW_KEY = "new key gate.max_climb_m_s (default 0.7)"


@pytest.fixture
def root() -> Iterator[CleanRoot]:
    with clean_root() as opened:
        yield opened


@pytest.fixture(scope="module")
def installed() -> Iterator[tuple[CleanRoot, str]]:
    """1.0 of a uav, which an installation takes seconds for, and what was said; whoever changes it changes it back."""
    with clean_root() as opened:
        yield opened, opened.run(f"{_MAKE} install VERSION=1.0 ROLE=uav")


def _modes(root: CleanRoot, *paths: str) -> list[str]:
    return root.run(f"stat -c '%A %U %G %n' {' '.join(paths)}").splitlines()


def _forget_a_key(root: CleanRoot, version: str) -> None:
    """As if that version had not known it."""
    root.run(
        f'sed -i \'s/"max_climb_m_s": {{/"was_called_otherwise": {{/\' /opt/companion/{version}/share/companion/*.json'
    )


def test_a_robot_is_installed_upgraded_rolled_back_and_left_alone(root: CleanRoot) -> None:
    said = root.run(f"{_MAKE} install VERSION=1.0 ROLE=uav")
    assert "/etc/companion/companion.yaml: the example of a uav" in said and "1.0 runs" in said
    assert "without the T265's reader" in said or Path("/usr/bin/python3.10").exists()
    assert _modes(root, "/etc/companion", "/etc/companion/companion.yaml", "/etc/companion/uav.key") == [
        "drwxr-x--- root companion /etc/companion",
        "-rw-r----- root companion /etc/companion/companion.yaml",
        "-rw------- companion root /etc/companion/uav.key",
    ]
    assert root.run("id -nG companion").split() == ["companion"]
    said = root.run("companion config check /etc/companion/companion.yaml", code=2)
    assert "peers[0].key_file: /etc/companion/beacon.key: cannot read the key" in said and said.count("_file:") == 1
    assert root.run("grep -c 'GROUP=\"plugdev\"' /etc/udev/rules.d/60-companion-t265.rules") == "2\n"
    assert root.run("head -1 /opt/companion/1.0/bin/companion") == "#!/opt/companion/1.0/bin/python\n"
    assert "`doctor system`" in root.run("cat /opt/companion/1.0/share/doc/troubleshooting.md")
    assert "/.new" not in root.run("cat /opt/companion/1.0/pyvenv.cfg /opt/companion/1.0/bin/activate")

    # Everything is ready but what no machine without the parts can have.
    root.run("companion keygen --owner companion /etc/companion/beacon.key")
    root.run("sed -i 's/192.168.1.255/127.255.255.255/' /etc/companion/companion.yaml")
    said = root.run("companion doctor all --seconds 0.5", code=1)
    assert {line[7:31].strip() for line in said.splitlines() if line.startswith("FAILED")} == _MISSING, said

    # Again, and an upgrade: what belongs to the robot stays, and what is new is said.
    root.run("sed -i 's/^name: uav/name: heron/' /etc/companion/companion.yaml; md5sum /etc/companion/uav.key > /key")
    root.run(f"{_MAKE} install VERSION=1.0 ROLE=uav")
    _forget_a_key(root, "1.0")
    root.run("echo '# of 1.1' >> systemd/companion.service")
    said = root.run(f"{_MAKE} install VERSION=1.1")
    assert "1.1 runs in place of 1.0" in said and _NEW_KEY in said
    assert "key gate.was_called_otherwise is no longer known" in said
    root.run("md5sum --check /key && grep '^name: heron' /etc/companion/companion.yaml")
    root.run("grep '# of 1.1' /etc/systemd/system/companion.service")

    # One command back, with the units of then; and forth again.
    assert "1.0 runs in place of 1.1" in root.run("make -s rollback")
    assert root.run("companion-setup versions") == "* 1.0\n- 1.1\n"
    root.run("grep '# of 1.1' /etc/systemd/system/companion.service", code=1)
    root.run("companion-setup rollback && companion-setup versions | grep '[*] 1.1'")
    root.run(f"{_MAKE} install VERSION=1.2")
    assert root.run("companion-setup versions") == "- 1.1\n* 1.2\n", "a version takes most of a gigabyte: two are kept"

    said = root.run("make -s uninstall")
    assert "stay; --purge takes them too" in said
    root.run("ls /opt/companion /etc/systemd/system/companion.service /usr/local/bin/companion", code=2)
    root.run("md5sum --check /key && make -s uninstall PURGE=1")
    root.run("ls /etc/companion || id companion", code=1)


def test_a_beacon_has_its_own_key_and_a_wrong_configuration_is_told(root: CleanRoot) -> None:
    root.run(f"{_MAKE} install VERSION=1.0 ROLE=beacon && ls /etc/companion/beacon.key")
    root.run("echo 'rolle: uav' >> /etc/companion/companion.yaml")
    said = root.run("companion-setup configure")
    assert "is not right yet: companion config check" in said
    root.run("sed -i '/^rolle/d; s/^ *interface: mon0/&/' /etc/companion/companion.yaml")
    root.run("printf 'ping:\\n  enabled: true\\n' >> /etc/companion/companion.yaml && companion-setup configure")
    root.run("grep CAP_NET_RAW /etc/systemd/system/companion-beacon.service.d/10-configuration.conf")


def test_nothing_is_changed_in_flight(installed: tuple[CleanRoot, str]) -> None:
    """A system that says it runs the service, and a service that says it flies."""
    root = installed[0]
    root.run("mkdir -p /run/systemd/system; printf '#!/bin/sh\\nexit 0\\n' > /usr/local/sbin/systemctl")
    root.run(
        'mv /opt/companion/1.0/bin/companion /kept; printf \'#!/bin/sh\\necho "{\\\\"armed\\\\": true}"\\n\' > /flying'
    )
    root.run("chmod +x /flying /usr/local/sbin/systemctl; cp /flying /opt/companion/1.0/bin/companion")
    for action in ("rollback", "configure", "remove", "idle", "activate 1.0"):
        expected = 1
        said = root.run(f"companion-setup {action}", code=expected)
        assert "land and disarm it first" in said or action == "rollback"
    root.run("mv /kept /opt/companion/1.0/bin/companion && rm -r /run/systemd/system /usr/local/sbin/systemctl")


def test_an_interpreter_that_only_root_can_run_is_told(installed: tuple[CleanRoot, str]) -> None:
    root, said = installed
    assert "cannot run" not in said
    root.run("mkdir /opt/companion/1.0/t265 && cp -a /opt/companion/1.0/bin /opt/companion/1.0/t265/")
    root.run("chmod go= /opt/companion/1.0/t265")
    assert "cannot run /opt/companion/current/t265/bin/python" in root.run("companion-setup activate 1.0")
    root.run("rm -r /opt/companion/1.0/t265")


def test_a_version_is_a_releases_or_a_commits(root: CleanRoot) -> None:
    """Without git, as in an unpacked archive, it is the program's own."""
    asked = "make -n install ROLE=uav | sed -n 's/.*companion-setup activate //p'"
    of_commit = root.run("git -C . rev-parse HEAD > /dev/null || exit 0; " + asked)
    assert not of_commit or re.fullmatch(rf'"{re.escape(__version__)}(\+r\d+\.[0-9a-f]+)?" uav\n', of_commit), of_commit
    root.run("rm -f $(command -v git)")
    assert root.run(asked) == f'"{__version__}" uav\n'


@pytest.mark.long
def test_the_kernel_is_compiled_for_the_service_before_its_first_start(root: CleanRoot) -> None:
    root.run(f"{_MAKE} install VERSION=1.0 ROLE=uav && companion-setup warm-up")
    assert "compiled kernel         kept in /var/cache/companion" in root.run("companion doctor system || true")


def test_wrong_usage_is_told(root: CleanRoot) -> None:
    setup = "sh systemd/companion-setup"
    assert "expected activate, rollback" in root.run(f"{setup} fly", code=2)
    assert "1.0: there is no such version" in root.run(f"{setup} activate 1.0", code=1)
    assert "there is no version before this one" in root.run(f"{setup} rollback", code=1)
    root.run("printf '#!/bin/sh\\necho /root/interpreters\\n' > /root/python && chmod +x /root/python")
    assert "below /root" in root.run(f"{_MAKE} install INSTALL_PYTHON=/root/python", code=2)


@pytest.mark.long
@pytest.mark.skipif(shutil.which("dpkg-deb") is None, reason="no dpkg-deb here")
def test_the_package_is_installed_upgraded_rolled_back_and_removed(root: CleanRoot) -> None:
    for version in ("1.0", "1.1"):
        root.run(f"{_MAKE} deb VERSION={version} && cp build/companion_{version}_*.deb /")
    assert "iw, iproute2" in root.run("dpkg-deb --field /companion_1.0_*.deb Depends")
    # dpkg asks for packages that this machine may not have; the package itself is what is tested.
    install = "dpkg --force-depends --install"
    said = root.run(f"COMPANION_ROLE=uav {install} /companion_1.0_*.deb")
    assert "the example of a uav" in said
    assert root.run("companion --version").startswith("companion, version ")
    _forget_a_key(root, "1.0")
    root.run("echo '# measured on this robot' >> /etc/companion/companion.yaml")
    kept = root.run(_CONFIGURATION)
    assert len(kept.splitlines()) >= 2, "the configuration and the robot's own key"
    said = root.run(f"{install} /companion_1.1_*.deb")
    assert "1.1 runs in place of 1.0" in said and _NEW_KEY in said
    assert root.run(_CONFIGURATION) == kept
    root.run("companion-setup rollback")
    assert root.run("companion-setup versions") == "* 1.0\n- 1.1\n"
    assert root.run(_CONFIGURATION) == kept
    check = "/opt/companion/current/bin/companion config check /etc/companion/companion.yaml"
    assert "peers[0].key_file" in root.run(check, code=2), "the other robot's key is brought by a person"
    root.run(f"companion keygen --owner companion /etc/companion/beacon.key && {check}")
    root.run("companion-setup rollback && dpkg --remove companion")
    root.run("ls /opt/companion || ls /usr/bin/companion || ls /etc/systemd/system/companion.service", code=2)
    root.run("ls /etc/companion/uav.key && dpkg --purge companion")
    root.run("ls /etc/companion || id companion", code=1)


_AS_SERVICE = (
    "setpriv --reuid companion --regid companion --groups dialout "
    "--inh-caps=-all,+net_admin --ambient-caps=-all,+net_admin --bounding-set=-all,+net_admin --no-new-privs "
    "env NUMBA_CACHE_DIR=/var/cache/companion sh -c "
    "'umask 027; exec companion run --config /etc/companion/companion.yaml'"
)
"""What companion.service gives its process, as far as it can be given without systemd."""


def test_the_service_runs_as_its_user_and_the_group_may_ask(installed: tuple[CleanRoot, str]) -> None:
    root = installed[0]
    root.run("companion keygen --owner companion /etc/companion/beacon.key")
    port, robots = free_udp_port("127.0.0.1"), free_udp_port("127.255.255.255")
    root.run(
        f"sed -i 's|192.168.1.255|127.255.255.255|; s|17650|{robots}|; s|serial:.*|udpin://127.0.0.1:{port}|' "
        "/etc/companion/companion.yaml"
    )
    root.run("for folder in run lib log cache; do parent=/var; [ $folder != run ] || parent=; "
             "install -d -m 750 -o companion -g companion $parent/$folder/companion; done")  # fmt: skip
    root.run("useradd --no-create-home --groups companion pilot && useradd --no-create-home stranger")
    root.run(f"{_AS_SERVICE} > /service.txt 2>&1 & echo $! > /pid")
    try:
        root.run(
            "for i in $(seq 50); do timeout 5 companion status > /status.txt 2>&1 && break; sleep 0.2; done; "
            "cat /service.txt /status.txt; grep -q idle /status.txt"
        )
        assert _modes(
            root, "/run/companion/control.sock", "/run/companion/status.sock", "/var/log/companion/log.mcap"
        ) == [
            "srw------- companion companion /run/companion/control.sock",
            "srw-rw---- companion companion /run/companion/status.sock",
            "-rw-r----- companion companion /var/log/companion/log.mcap",
        ]
        pilot = "setpriv --reuid pilot --regid pilot --init-groups"
        assert "idle" in root.run(f"{pilot} companion status")
        assert "permission denied" in root.run(f"{pilot} companion engage", code=1)
        stranger = "setpriv --reuid stranger --regid stranger --init-groups"
        assert "permission denied" in root.run(f"{stranger} companion status", code=1)
        # What the running service holds it is asked for; what it lacks is named.
        assert "the running service hears none" in root.run("companion doctor autopilot", code=1)
    finally:
        root.run("kill $(cat /pid); for i in $(seq 100); do [ -e /proc/$(cat /pid) ] || break; sleep 0.1; done")
