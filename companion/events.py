"""Inputs that are no bytes of a device, as the log holds them: a tick, a wish, an outcome, an answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from companion.boots import Reached
from companion.mission import Event


@dataclass(frozen=True, slots=True)
class Tick:
    """The control loop ran."""

    t_mono_ns: int


@dataclass(frozen=True, slots=True)
class Wish:
    """A person asked for something; `refusal` is the answer, empty when it was granted. What an engagement asks of the
    autopilot takes a while: this is when it was answered."""

    t_mono_ns: int
    wish: Event
    refusal: str
    by_switch: bool = False
    """By the switch on the transmitter, not by a command."""


@dataclass(frozen=True, slots=True)
class CommandOutcome:
    """A command to the autopilot has ended: what the mission is told (None for nothing), and why it failed."""

    t_mono_ns: int
    event: Event | None
    error: str


@dataclass(frozen=True, slots=True)
class BookState:
    """How far each peer (by its id) had got when the service began."""

    t_mono_ns: int
    reached: Mapping[str, Reached]


@dataclass(frozen=True, slots=True)
class WorkerState:
    """The AOA worker began or ceased to wait for apertures."""

    t_mono_ns: int
    is_ready: bool


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to aperture `id` arrived. `failure` says what happened to the worker; empty when it computed."""

    t_mono_ns: int
    id: int
    peer: int
    compute_s: float
    failure: str
