"""The files that go with the program, from a clone, a wheel or a zip alike."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import PurePosixPath
from typing import Final

_FOLDERS: Final = ("configs", "systemd")
_FILES: Final = ("requirements.txt",)


def shipped_text(path: str) -> str:
    """For example "configs/uav.yaml". Raises FileNotFoundError."""
    return _root().joinpath(path).read_text(encoding="utf-8")


def shipped_paths() -> list[str]:
    """All of them, as `shipped_text` takes them."""
    below = (path for folder in _FOLDERS for path in _below(_root().joinpath(folder), PurePosixPath(folder)))
    return sorted([*_FILES, *below])


def _root() -> Traversable:
    return resources.files("companion.shipped")


def _below(folder: Traversable, path: PurePosixPath) -> Iterator[str]:
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _below(entry, path / entry.name)
        else:
            yield str(path / entry.name)
