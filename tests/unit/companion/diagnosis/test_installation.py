"""What doctor says of the installation: units of this version and configuration, files that the service can read."""

from __future__ import annotations

import dataclasses
import os
import pwd
from pathlib import Path

import pytest

from companion.config.file import load_config
from companion.config.schema import Config
from companion.config.unit_settings import drop_in
from companion.diagnosis import installation
from companion.diagnosis.installation import installation_checks, key_check
from companion.neighbours.keys import write_key
from companion.radio.checks import Check
from companion.shipped.files import shipped_text
from tests.paths import CONFIGS


@pytest.fixture
def config(monkeypatch: pytest.MonkeyPatch) -> Config:
    """Of a robot whose service runs as the user of these tests."""
    monkeypatch.setattr(installation, "SERVICE_USER", pwd.getpwuid(os.getuid()).pw_name)
    return load_config(CONFIGS / "uav.yaml")


def _checks(config: Config, root: Path) -> dict[str, Check]:
    return {check.name: check for check in installation_checks(config, CONFIGS / "uav.yaml", root)}


def _install(config: Config, root: Path) -> Path:
    folder = root / "etc/systemd/system"
    (folder / "companion.service.d").mkdir(parents=True)
    (folder / "companion.service").write_text(shipped_text("systemd/companion.service"))
    (folder / "companion.service.d" / "10-configuration.conf").write_text(drop_in(config) + "\n")
    return folder


def test_units_of_this_version_and_configuration_are_right(config: Config, tmp_path: Path) -> None:
    assert _checks(config, tmp_path)["unit"].remedy == "sudo make install"
    folder = _install(config, tmp_path)
    found = _checks(config, tmp_path)
    assert found["unit"].ok and found["unit's permissions"].ok
    assert found["service"].ok is None and found["at boot"].remedy == "systemctl enable companion.service"
    (folder / "companion.service").write_text("[Service]\n")
    other = _checks(config, tmp_path)["unit"]
    assert other.found == "companion.service is of another version"
    assert other.remedy.startswith("companion-setup activate VERSION, as root")


def test_pings_that_the_unit_does_not_permit_are_told(config: Config, tmp_path: Path) -> None:
    _install(config, tmp_path)
    pings = dataclasses.replace(config, ping=dataclasses.replace(config.ping, enabled=True))
    found = _checks(pings, tmp_path)["unit's permissions"]
    assert found.ok is False and found.remedy == "companion-setup configure, as root"


def test_a_user_that_is_not_there_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "SERVICE_USER", "no-such-user")
    found = _checks(load_config(CONFIGS / "uav.yaml"), tmp_path)["user"]
    assert found.ok is False and "make install" in found.remedy


def test_a_configuration_that_anybody_may_change_is_told(config: Config, tmp_path: Path) -> None:
    path = tmp_path / "open.yaml"
    path.write_text("")
    path.chmod(0o666)
    (found,) = [one for one in installation_checks(config, path, tmp_path) if one.name == "configuration"]
    assert found.ok is False and found.remedy == f"chmod o-w {path}"


def test_a_key_is_its_owners_alone(config: Config, tmp_path: Path) -> None:
    path = tmp_path / "uav.key"
    assert "keygen" in key_check("own key", path).remedy
    assert "copy it from that robot" in key_check("key of beacon", path).remedy
    write_key(path)
    assert key_check("own key", path).ok
    path.chmod(0o640)
    assert key_check("own key", path).remedy == f"chmod 600 {path}"


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give files away")
def test_a_key_of_somebody_else_is_told(config: Config, tmp_path: Path) -> None:
    write_key(tmp_path / "a.key", "nobody")
    found = key_check("own key", tmp_path / "a.key")
    assert found.ok is False and "belongs to nobody" in found.found
