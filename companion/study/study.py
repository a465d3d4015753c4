"""What a study is: a plan of trials, one trial as a pure function, and what to say and draw of the rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from numpy.random import SeedSequence

if TYPE_CHECKING:
    from matplotlib.figure import Figure

S = TypeVar("S")
R = TypeVar("R")

Value = float | str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One quantity, ours beside the paper's. None: not given."""

    quantity: str
    ours: Value
    paper: Value = None
    unit: str = ""
    interval: tuple[float, float] | None = None
    """Of 95 %, where ours is a share."""


@dataclass(frozen=True, slots=True)
class Summary:
    """What the rows say."""

    findings: list[Finding]
    notes: list[str]
    scenes: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)
    """Figures of each scene by name, for programs; empty where a study has none."""


@dataclass(frozen=True, slots=True)
class Settings:
    """What a plan may depend on: how many trials a condition has, where real recordings are, which scenes are asked for
    (none means all), whether missions' motion goes by the fixed rule or is chosen, and whether their distance and North
    are the scene's or drawn."""

    trials: int
    data: Path
    scenes: tuple[str, ...] = ()
    motion: Literal["chosen", "fixed"] = "chosen"
    truths: Literal["fixed", "drawn"] = "fixed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Study(Generic[S, R]):
    """`figures` names the paper's labels. `trial` and the specifications must pickle: module-level, and plain data.

    With `row`, the type of a row, finished trials are kept and another run goes on from them: then `trial` takes its
    random stream from the specification and the seed's entropy, since its place in the plan may change.
    """

    name: str
    title: str
    figures: tuple[str, ...]
    default_trials: int
    plan: Callable[[Settings], Sequence[S]]
    trial: Callable[[S, SeedSequence], R]
    summarise: Callable[[Sequence[R]], Summary]
    draw: Callable[[Sequence[R], Figure], None]
    size_in: tuple[float, float] = (10.0, 4.6)
    row: type[R] | None = None
    table: Callable[[Outcome], str] | None = None
    """The result as a page of Markdown."""


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
    scenes: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)
    rows: list[Any]
