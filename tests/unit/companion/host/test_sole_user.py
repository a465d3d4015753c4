"""A lock that ends with its process, however that ends."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from companion.errors import ConfigError
from companion.host.sole_user import SoleUser

_HOLDER = """
import sys
from pathlib import Path
from companion.host.sole_user import SoleUser
held = SoleUser(Path(sys.argv[1]), "state_dir")
print("held", flush=True)
sys.stdin.read()
"""


def test_a_killed_process_leaves_no_lock_and_a_living_one_is_told(tmp_path: Path) -> None:
    path = tmp_path / "boots.json"
    with subprocess.Popen(
        [sys.executable, "-c", _HOLDER, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout is not None
        try:
            assert holder.stdout.readline() == b"held\n"
            with pytest.raises(ConfigError, match=r"state_dir: .*boots\.json is in use"):
                SoleUser(path, "state_dir")
        finally:
            holder.send_signal(signal.SIGKILL)
    SoleUser(path, "state_dir").close()


def test_a_lock_file_that_may_only_be_read_serves_as_well(tmp_path: Path) -> None:
    path = tmp_path / "boots.json"
    (tmp_path / ".boots.json.lock").touch(0o444)
    SoleUser(path, "state_dir").close()
