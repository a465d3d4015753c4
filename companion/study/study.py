"""What a study is: a plan of trials, one trial as a pure function, and what to say and draw of the rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from numpy.random import SeedSequence

if TYPE_CHECKING:
    from matplotlib.figure import Figure

S = TypeVar("S")
R = TypeVar("R")

Value = float | str | None


@dataclass(frozen=True, slots=True)
class Finding:
    """One quantity, ours beside the paper's. None: not given."""

    quantity: str
    ours: Value
    paper: Value = None
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Summary:
    """What the rows say."""

    findings: list[Finding]
    notes: list[str]


@dataclass(frozen=True, slots=True)
class Settings:
    """What a plan may depend on: how many trials a condition has, and where real recordings are."""

    trials: int
    data: Path


@dataclass(frozen=True, slots=True)
class Study(Generic[S, R]):
    """`figures` names the paper's labels. `trial` and the specifications must pickle: module-level, and plain data."""

    name: str
    title: str
    figures: tuple[str, ...]
    default_trials: int
    plan: Callable[[Settings], Sequence[S]]
    trial: Callable[[S, SeedSequence], R]
    summarise: Callable[[Sequence[R]], Summary]
    draw: Callable[[Sequence[R], Figure], None]
    size_in: tuple[float, float] = (10.0, 4.6)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """One study's result, as `--json` holds it: numbers that are infinite are null there."""

    study: str
    title: str
    figures: tuple[str, ...]
    seed: int
    trials: int
    elapsed_s: float
    findings: list[Finding]
    notes: list[str]
    rows: list[Any]
