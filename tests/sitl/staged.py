"""`PYTHON staged.py`, in a booted root: the demo's robots as they would be installed, and the world around them.

Run by the installed version's own interpreter, which knows no repository. Writes /etc/companion for the flying robot,
below /srv/stage what the world, the mock autopilot and the beacon need; with `--mode` it prints the mock's mode.
"""

from __future__ import annotations

import dataclasses
import os
import shutil
import socket
import sys
from pathlib import Path
from typing import Final

import msgspec

from companion.config.file import save_config
from companion.config.schema import Config
from companion.sim.px4.report import Px4Report
from companion.sim.scenario import encode_scenario
from companion.sim.stage import Cast, set_stage

_FOLDER: Final = Path("/srv/stage")
_ETC: Final = Path("/etc/companion")
_RUNTIME: Final = "/run/companion"
_SEED: Final = 5


def main() -> None:
    if "--mode" in sys.argv:
        print(_mode())
        return
    shutil.rmtree(_FOLDER, ignore_errors=True)
    _FOLDER.mkdir(parents=True)
    stage = set_stage(_FOLDER, _FOLDER, _SEED, use_netlink=False)
    for name in ("uav.key", "beacon.key"):
        shutil.copyfile(_FOLDER / "uav" / name, _ETC / name)
        shutil.chown(_ETC / name, "companion")
        (_ETC / name).chmod(0o600)
    _save(_installed(stage.uav), _ETC / "companion.yaml")
    _save(_installed(stage.beacon), _FOLDER / "beacon-as-installed.yaml")
    scenario = encode_scenario(stage.scenario).replace(f"{stage.uav.path('')}/".encode(), f"{_RUNTIME}/".encode())
    (_FOLDER / "scenario.json").write_bytes(scenario)
    options = Cast(stage, _FOLDER, "--control", str(_FOLDER / "px4.sock"))._px4_options
    px4 = ("--connect", f"127.0.0.1:{stage.mavlink_port}", "--truth", stage.scenario.truth_in, "--seed", str(_SEED))
    (_FOLDER / "px4").write_text(" ".join((*px4, *options)))


def _installed(config: Config) -> Config:
    """The robot's files where an installation has them."""
    peers = [dataclasses.replace(peer, key_file=str(_ETC / f"{peer.name}.key")) for peer in config.peers]
    return dataclasses.replace(
        config,
        runtime_dir=_RUNTIME,
        state_dir="/var/lib/companion",
        peers=peers,
        neighbours=dataclasses.replace(config.neighbours, key_file=str(_ETC / f"{config.name}.key")),
        recorder=dataclasses.replace(config.recorder, path="/var/log/companion/log.mcap"),
        page=dataclasses.replace(config.page, enabled=config.role == "uav"),
    )


def _save(config: Config, path: Path) -> None:
    save_config(config, path)
    shutil.chown(path, "root", "companion")
    path.chmod(0o640)


def _mode() -> str:
    answer = _FOLDER / f"answer-{os.getpid()}.sock"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ours:
        ours.bind(str(answer))
        ours.settimeout(5.0)
        ours.sendto(b"report", str(_FOLDER / "px4.sock"))
        return msgspec.msgpack.decode(ours.recv(1 << 16), type=Px4Report).mode


if __name__ == "__main__":
    main()
