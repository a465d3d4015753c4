"""Finished trials on disk, so that a run of hours that ends early goes on where it was.

One JSON line a trial, its specification and its row. The file's name carries the seed and a digest of the code that a
trial runs on: rows of other code are neither mixed in nor lost.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import msgspec

import companion
import csi_bridge
import wsr
from companion.errors import CompanionError

S = TypeVar("S")
R = TypeVar("R")

_APART: Final = frozenset({"commands", "pictures", "report", "replay"})
"""Rooms that no trial runs on, as no `*_figures.py` is: they tell and draw what rows say."""


class KeptRows(Generic[S, R]):
    """Rows of type `row`, by their specifications. A context manager: the file is open for what comes."""

    def __init__(self, folder: Path, name: str, seed: int, row: type[R]) -> None:
        self.path: Final = folder / f"{name}-{seed}-{code_digest()}.jsonl"
        self._row = row
        self._rows: dict[bytes, R] = {}

    def __enter__(self) -> KeptRows[S, R]:
        """Raises CompanionError when the file cannot be written, or a line of it but the last is none of ours."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("a+b")
        except OSError as error:
            raise CompanionError(f"{self.path}: cannot be written: {error.strerror}") from None
        try:
            self._file.seek(0)
            self._file.truncate(self._read(self._file))
        except BaseException:
            self._file.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def row(self, spec: S) -> R | None:
        return self._rows.get(msgspec.json.encode(spec))

    def add(self, specs: Iterable[S], rows: Sequence[R]) -> None:
        """Written at once: what was added outlives this process."""
        for spec, row in zip(specs, rows, strict=True):
            key = msgspec.json.encode(spec)
            self._rows[key] = row
            self._file.write(b'{"spec":' + key + b',"row":' + msgspec.json.encode(row) + b"}\n")
        self._file.flush()

    def _read(self, lines: Iterable[bytes]) -> int:
        """How many bytes are whole lines: a process that was killed may leave half of one."""
        size = 0
        for number, line in enumerate(lines, start=1):
            if not line.endswith(b"\n"):
                break
            try:
                entry = msgspec.json.decode(line)
                self._rows[msgspec.json.encode(entry["spec"])] = msgspec.convert(entry["row"], self._row)
            except (msgspec.DecodeError, KeyError, TypeError) as error:
                raise CompanionError(f"{self.path}: line {number} is no finished trial: {error}; remove it") from None
            size += len(line)
        return size


def code_digest() -> str:
    """Of every source file that a trial may run on."""
    digest = hashlib.blake2b(digest_size=4)
    for path in _sources():
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _sources() -> Iterator[Path]:
    packages: tuple[Any, ...] = (companion, csi_bridge, wsr)
    for package in packages:
        root = Path(package.__file__).parent
        for path in sorted(root.rglob("*.py")):
            if path.relative_to(root).parts[0] not in _APART and not path.stem.endswith("_figures"):
                yield path
