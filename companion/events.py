"""Inputs that are no bytes of a device, as the log holds them: a tick, a wish, an outcome, an answer."""

from __future__ import annotations

from dataclasses import dataclass

from companion.mission import Event


@dataclass(frozen=True, slots=True)
class Tick:
    """The control loop ran."""

    t_mono_ns: int


@dataclass(frozen=True, slots=True)
class Wish:
    """A person asked for something; `refusal` is the answer, empty when it was granted."""

    t_mono_ns: int
    wish: Event
    refusal: str


@dataclass(frozen=True, slots=True)
class CommandOutcome:
    """A command to the autopilot has ended: what the mission is told (None for nothing), and why it failed."""

    t_mono_ns: int
    event: Event | None
    error: str


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
