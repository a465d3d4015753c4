"""The connection of the MAVSDK edge: open, find the autopilot, send, close.

Only the library's plain callback interface is used. Its asyncio wrapper puts every message of a subscription into an
unbounded queue; here each message lands in the caller's `on_message` on the library's thread. `send_message` only
appends to the library's own bounded send queue (measured: it returns at once even when a serial line takes nothing), so
it is called on the event loop.
"""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import errno
import functools
import json
import logging
import os
import socket
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import mavsdk
from mavsdk.autopilot import Autopilot as Kind
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage

from companion.autopilot.port import AutopilotError

_LOG = logging.getLogger(__name__)
_NATIVE_LOG = logging.getLogger("mavsdk")
_CLOSE_TIMEOUT_S = 3.0
_LOOK_S = 0.02
_ONBOARD_COMPUTER = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER."""
_known = threading.local()
_NAMES = {Kind.PX4: "PX4", Kind.ARDUPILOT: "ArduPilot"}


class MavsdkLink:
    """One MAVSDK connection such as udpin://127.0.0.1:14540 or serial:///dev/ttyS1:921600; may be opened again.

    It speaks to one vehicle: that of `system_id`, or without one the first PX4 it has heard, for as long as it lives.
    `on_message` gets the name, the sender's component id and the fields as JSON, on the library's thread. We are a
    component of system 1, as the library has it, or with `is_of_vehicle` the onboard computer of the vehicle's own
    system, as a ground station looks for it.
    """

    def __init__(
        self,
        *,
        url: str,
        names: Iterable[str],
        on_message: Callable[[str, int, str], None],
        system_id: int | None = None,
        is_of_vehicle: bool = False,
    ) -> None:
        self.url = url
        self.system_id = system_id
        self._is_of_vehicle = is_of_vehicle
        self._names = tuple(names)
        self._on_message = on_message
        self._mavsdk: Any = None
        self._direct: Any = None
        self._native = threading.Lock()
        """Held while the library opens a connection, or is destroyed: both at once crash it, or hang."""

    async def open(self, timeout_s: float) -> None:
        """Raises AutopilotError when the port is taken, or our vehicle is not heard within `timeout_s` or is no PX4.

        What can be seen without the library is seen before there is one."""
        _refuse_taken_port(self.url)
        _refuse_missing_device(self.url)
        _route_native_log()
        deadline_s = time.monotonic() + timeout_s
        while True:
            ours = self._begin()
            try:
                system = await self._find_autopilot(max(_LOOK_S, deadline_s - time.monotonic()))
                if not self._is_of_vehicle or system.get_system_id() == ours:
                    self._subscribe(system)
                    return
                self.system_id = system.get_system_id()
                await self.aclose()  # once: now it is known of which system we must be
            except BaseException:
                await self.aclose()
                raise

    def _begin(self) -> int:
        """A library without connections; our own system id in it."""
        kind = mavsdk.ComponentType.COMPANION_COMPUTER
        configuration = mavsdk.Configuration.create_with_component_type(kind)
        if self._is_of_vehicle:
            configuration.system_id, configuration.component_id = self.system_id or 1, _ONBOARD_COMPUTER
        self._mavsdk = mavsdk.Mavsdk(configuration)
        return self.system_id or 1

    async def aclose(self) -> None:
        """Bounded in time, and harmless when repeated."""
        library, self._mavsdk, self._direct = self._mavsdk, None, None
        if library is None:
            return
        loop, closed = asyncio.get_running_loop(), asyncio.Event()

        def close() -> None:
            with self._native:
                library.destroy()
            with contextlib.suppress(RuntimeError):  # the loop is gone: nobody waits any more
                loop.call_soon_threadsafe(closed.set)

        # Joins the library's threads. On a daemon thread: should it ever hang, it must not hold up the process's exit.
        threading.Thread(target=close, name="mavsdk-close", daemon=True).start()
        try:
            await asyncio.wait_for(closed.wait(), _CLOSE_TIMEOUT_S)
        except TimeoutError:
            _LOG.error("autopilot %s: the library did not close within %g s", self.url, _CLOSE_TIMEOUT_S)

    def send(self, name: str, /, **fields: Any) -> None:
        """One message with every field of it: the library sends one that is missing as zero. None is sent as NaN.

        Raises AutopilotError when the link is closed or the library refuses.
        """
        if self._direct is None:
            raise AutopilotError(f"autopilot {self.url}: not connected; {name} was not sent")
        text = json.dumps(fields, allow_nan=False)
        try:
            self._direct.send_message(MavlinkMessage(name, 0, 0, self.system_id or 0, 1, text))
        except MavsdkError as error:
            raise AutopilotError(f"autopilot {self.url}: {name} was not sent: {error}") from error

    def send_addressed(self, name: str, /, **fields: Any) -> None:
        self.send(name, target_system=self.system_id, target_component=1, **fields)

    async def _find_autopilot(self, timeout_s: float) -> Any:
        try:
            await self._connect()
        except MavsdkError as error:
            wanted = "expected udpin://HOST:PORT or serial:///DEV:BAUD"
            raise AutopilotError(f"autopilot {self.url}: {error}; {wanted}") from error
        return await self._vehicle(timeout_s)

    async def _connect(self) -> None:
        """On a daemon thread: opening a serial port may take a while, or for ever. Raises MavsdkError."""
        library, loop = self._mavsdk, asyncio.get_running_loop()
        done: asyncio.Future[None] = loop.create_future()

        def finish(error: MavsdkError | None) -> None:
            if not done.done():
                done.set_exception(error) if error is not None else done.set_result(None)

        def connect() -> None:
            failure: MavsdkError | None = None
            try:
                with self._native:
                    library.add_any_connection_with_handle(self.url)
            except MavsdkError as error:
                failure = error
            with contextlib.suppress(RuntimeError):  # the loop is gone: nobody waits any more
                loop.call_soon_threadsafe(finish, failure)

        threading.Thread(target=connect, name="mavsdk-open", daemon=True).start()
        await done

    async def _vehicle(self, timeout_s: float) -> Any:
        deadline_s = time.monotonic() + timeout_s
        while True:
            systems = [system for system in self._mavsdk.get_systems() if system.has_autopilot()]
            for system in systems:  # in the order in which they were first heard
                is_px4 = system.autopilot_type() is Kind.PX4
                if is_px4 and self.system_id in (None, system.get_system_id()) and system.is_connected():
                    return system
            if time.monotonic() > deadline_s:
                raise AutopilotError(self._why_nobody(systems, timeout_s))
            await asyncio.sleep(_LOOK_S)

    def _why_nobody(self, systems: list[Any], timeout_s: float) -> str:
        heard = {system.get_system_id(): system.autopilot_type() for system in systems if system.is_connected()}
        texts = {
            number: f"system {number} ({_NAMES.get(kind, 'an unknown autopilot')})" for number, kind in heard.items()
        }
        others = ", ".join(text for number, text in texts.items() if number != self.system_id)
        if self.system_id in texts or (self.system_id is None and texts):
            found = texts.get(self.system_id or 0, others)
            return f"autopilot {self.url}: {found} is no PX4 and is left alone"
        ours = "an autopilot" if self.system_id is None else f"system {self.system_id}"
        left = f"; heard and left alone: {others}" if others else ""
        return f"autopilot {self.url}: no heartbeat of {ours} within {max(1, round(timeout_s))} s{left}"

    def _subscribe(self, system: Any) -> None:
        """The library takes no part in TIMESYNC (`enable_timesync`): it would answer with the vehicle's time as it
        found it up to 5 s ago by the wall clock, which may step."""
        self.system_id = system.get_system_id()
        self._direct = MavlinkDirect(system)
        for name in self._names:
            self._direct.subscribe_message(name, self._take)

    def others(self) -> set[str]:
        """The other vehicles that are heard on the link, in words."""
        systems = [] if self._mavsdk is None else self._mavsdk.get_systems()
        return {_name(s) for s in systems if s.has_autopilot() and s.get_system_id() != self.system_id}

    def _take(self, message: MavlinkMessage, user_data: object) -> None:
        _stay()
        if message.system_id == self.system_id:
            self._on_message(message.message_name, message.component_id, message.fields_json)


def _stay() -> None:
    """A thread of the library is known to the interpreter while it calls us: what that is kept in is made and thrown
    away for each message, with pages of memory that the kernel clears. One claim that is never given back keeps it."""
    if not hasattr(_known, "is_kept"):
        _known.is_kept = True
        ctypes.pythonapi.PyGILState_Ensure()


def _name(system: Any) -> str:
    return f"system {system.get_system_id()} ({_NAMES.get(system.autopilot_type(), 'an unknown autopilot')})"


def _refuse_taken_port(url: str) -> None:
    """The library binds a UDP port that is already bound without complaint, and both then hear half."""
    parts = urlsplit(url)
    if parts.scheme not in ("udp", "udpin"):
        return
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((parts.hostname or "0.0.0.0", parts.port or 0))
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise AutopilotError(f"autopilot {url}: the port is taken by another process") from None


def _refuse_missing_device(url: str) -> None:
    """No library is made for a serial line that is not there: it would come to nothing, and may crash at the end."""
    parts = urlsplit(url)
    if not parts.scheme.startswith("serial"):
        return
    device = Path(parts.path.split(":")[0])
    if not device.exists():
        raise AutopilotError(f"autopilot {url}: there is no device {device}")
    if not os.access(device, os.R_OK | os.W_OK):
        raise AutopilotError(f"autopilot {url}: no permission for {device}; its group is usually dialout")


@functools.cache  # once: the library may be calling the old callback while it is replaced
def _route_native_log() -> None:
    mavsdk.log_subscribe(_log_native)


def _log_native(level: int, message: str, file: str | None, line: int) -> bool:
    """The library's log lines go to logging; True keeps them off standard output."""
    levels = (logging.DEBUG, logging.INFO, logging.WARNING, logging.ERROR)
    _NATIVE_LOG.log(levels[level], "%s", message)
    return True
