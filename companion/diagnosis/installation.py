"""How it was installed: the service's user, who may read what, and whether the units are those of this version."""

from __future__ import annotations

import os
import pwd
import stat
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from companion.config.schema import Config
from companion.config.unit_settings import drop_in, unit_of
from companion.errors import ConfigError
from companion.neighbours.keys import read_key
from companion.radio.checks import Check
from companion.shipped.files import shipped_text
from csi_bridge.regular_file import read_regular

SERVICE_USER: Final = "companion"
_UNITS: Final = Path("etc/systemd/system")
_CONFIGURE: Final = "companion-setup configure, as root"
_ACTIVATE: Final = "companion-setup activate VERSION, as root; companion-setup versions lists them"
"""Configuring leaves the unit itself as it is."""
_TIMEOUT_S: Final = 10


def installation_checks(config: Config, config_path: Path, root: Path) -> Iterator[Check]:
    """`root` is / but in tests."""
    user = _user()
    yield user
    yield _readable(config_path, user.ok is True)
    unit = unit_of(config)
    yield from _unit(config, unit, root)
    yield _running(unit, root)


def _user() -> Check:
    try:
        entry = pwd.getpwnam(SERVICE_USER)
    except KeyError:
        return Check("user", False, f"there is no user {SERVICE_USER}", "sudo make install ROLE=uav, or beacon")
    return Check("user", True, f"{SERVICE_USER}, id {entry.pw_uid}")


def _readable(path: Path, has_user: bool) -> Check:
    """By the service: its owner, or its group."""
    try:
        found = path.stat()
    except OSError as error:
        return Check("configuration", None, f"{path}: {error.strerror}")
    entry = pwd.getpwnam(SERVICE_USER) if has_user else None
    mode = stat.S_IMODE(found.st_mode)
    theirs = entry is not None and (
        (found.st_uid == entry.pw_uid and mode & stat.S_IRUSR) or (found.st_gid == entry.pw_gid and mode & stat.S_IRGRP)
    )
    if mode & stat.S_IWOTH:
        return Check("configuration", False, f"{path}: anybody may change it", f"chmod o-w {path}")
    ok = bool(theirs or mode & stat.S_IROTH)
    remedy = "" if ok else f"chgrp {SERVICE_USER} {path}; chmod 640 {path}"
    return Check(
        "configuration", ok, f"{path}, mode {mode:o}" + ("" if ok else ", which the service cannot read"), remedy
    )


def _unit(config: Config, unit: str, root: Path) -> Iterator[Check]:
    file = root / _UNITS / unit
    try:
        same = file.read_text() == shipped_text(f"systemd/{unit}")
    except OSError as error:
        yield Check("unit", False, f"{unit}: {error.strerror}", "sudo make install")
        return
    yield Check("unit", same, f"{unit}{'' if same else ' is of another version'}", "" if same else _ACTIVATE)
    try:
        fits = (root / _UNITS / f"{unit}.d" / "10-configuration.conf").read_text().strip() == drop_in(config).strip()
    except OSError:
        fits = False
    asked = ", with what pings need" if config.ping.enabled else ""
    found = f"as the configuration needs them{asked}" if fits else "of another configuration"
    yield Check("unit's permissions", fits, found, "" if fits else _CONFIGURE)
    enabled = (root / _UNITS / "multi-user.target.wants" / unit).is_symlink()
    if enabled:
        yield Check("at boot", True, "is started")
    else:
        yield Check("at boot", None, "is not started", f"systemctl enable {unit}")


def _running(unit: str, root: Path) -> Check:
    if not (root / "run/systemd/system").is_dir():
        return Check("service", None, "systemd does not run this machine")
    try:
        done = subprocess.run(
            ["systemctl", "is-active", unit], capture_output=True, text=True, timeout=_TIMEOUT_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return Check("service", None, f"systemctl: {error}")
    state = done.stdout.strip()
    failed = state == "failed"
    return Check("service", not failed, f"{unit} is {state}", f"journalctl -u {unit} -n 20" if failed else "")


def key_check(name: str, path: Path) -> Check:
    """A key file as the service reads it. Whoever may not read it, cannot look at it."""
    try:
        found = path.stat()
        key = read_regular(path)
    except FileNotFoundError:
        remedy = (
            f"companion keygen --owner {SERVICE_USER} {path}"
            if name == "own key"
            else f"copy it from that robot: {path}"
        )
        return Check(name, False, f"{path} is not there", remedy)
    except OSError as error:
        return Check(name, None, f"{path}: {error.strerror}", "as root")
    owner = _name_of(found.st_uid)
    mode = stat.S_IMODE(found.st_mode)
    if mode & 0o077:
        return Check(name, False, f"{path}: mode {mode:o}, others may read it", f"chmod 600 {path}")
    try:
        read_key(path)
    except ConfigError as error:
        return Check(name, False, str(error), "copy it again")
    by_hand = os.getuid() != 0 and found.st_uid == os.getuid()
    if owner != SERVICE_USER and not by_hand and _user().ok:
        return Check(name, False, f"{path} belongs to {owner}", f"chown {SERVICE_USER} {path}")
    return Check(name, True, f"{path}, {len(key)} bytes, of {owner}")


def _name_of(uid: int) -> str:
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)
