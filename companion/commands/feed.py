"""`companion feed`: a recorded CSI log into the kernel's netlink, as the driver would report it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import click
from rich.progress import Progress

from companion.commands.numbers import Number
from companion.commands.output_files import check_writable, write_json
from companion.commands.terminal import Console, bar_columns
from companion.errors import CompanionError
from csi_bridge.dat_frames import DatFileError
from csi_bridge.feitcsi.netlink import VendorEventFeeder, port_has_listener, vendor_events_available
from csi_bridge.netlink import (
    DEFAULT_CONNECTOR_IDX,
    NetlinkError,
    NetlinkFeeder,
    connector_available,
    group_has_listener,
)
from csi_bridge.replay import Feeder, play, read_tape
from csi_bridge.unix_socket import UnixFeeder, is_listened_on

_PATIENCE_S: Final = 3.0


@click.command()
@click.argument("file", type=click.Path(path_type=Path, readable=False))
@click.option(
    "--rate",
    type=Number(0.01, 1000),
    default=1.0,
    show_default=True,
    help="How much faster than recorded. Times fit the card's stamps only at 1.",
)
@click.option(
    "--connector-idx",
    type=click.IntRange(1, 32),
    default=DEFAULT_CONNECTOR_IDX,
    show_default=True,
    help="csi.connector_idx of the service: its connector group, or, for an AX card's log, its generic netlink port.",
)
@click.option("--unix", "unix_path", type=click.Path(path_type=Path), help="Instead, the service's CSI socket.")
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the result here.")
def feed(file: Path, rate: float, connector_idx: int, unix_path: Path | None, json_path: Path | None) -> None:
    """Play the CSI log FILE to a running service, which cannot tell it from the driver.

    Needs root for the connector; the service must be running already, with csi.require_kernel_sender: false.
    """
    check_writable(json_path)
    try:
        tape = read_tape(file)
        netlink = VendorEventFeeder if tape.is_feitcsi else NetlinkFeeder
        feeder: Feeder = netlink(connector_idx) if unix_path is None else UnixFeeder(unix_path)
    except DatFileError as error:
        raise CompanionError(str(error)) from None
    except NetlinkError as error:
        raise _no_connector(connector_idx, error) from None
    if unix_path is not None:
        _await(lambda: is_listened_on(unix_path), f"{unix_path}: no service listens there", "csi.source: unix")
    elif tape.is_feitcsi:
        _await_port(connector_idx)
    else:
        if group_has_listener(connector_idx) is False and (reason := connector_available(connector_idx)) is not None:
            raise CompanionError(f"connector {connector_idx}: {reason}; --unix SOCKET works without")
        name, wanted = f"connector {connector_idx}", f"csi.source: netlink and csi.connector_idx: {connector_idx}"
        _await(lambda: group_has_listener(connector_idx) is not False, f"{name}: nobody has joined that group", wanted)
    start_s = time.monotonic()
    sent = taken = 0
    console = Console(stderr=True)
    with Progress(*bar_columns(), console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(f"feeding {file.name}", total=len(tape.records))
        try:
            for progressed in play(tape, feeder, rate):
                sent, taken = progressed
                progress.update(task, completed=sent)
        except NetlinkError as error:
            raise _no_connector(connector_idx, error) from None
    feeder.close()
    result = {
        "file": str(file),
        "records": sent,
        "taken": taken,
        "recorded_s": tape.duration_s,
        "seconds": time.monotonic() - start_s,
    }
    click.echo(f"{file.name}: {sent} records in {result['seconds']:.2f} s, {sent - taken} refused by the receiver")
    if json_path is not None:
        write_json(json_path, result)
    if not taken:
        raise CompanionError(
            f"{file}: none of its {sent} records was taken: the receiver is gone, or its buffer is full"
        )


def _await_port(idx: int) -> None:
    if port_has_listener(idx) is False and (reason := vendor_events_available(idx)) is not None:
        raise CompanionError(f"generic netlink {idx}: {reason}; --unix SOCKET works without")
    wanted = f"csi.source: nl80211 and csi.connector_idx: {idx}"
    _await(lambda: port_has_listener(idx) is not False, f"generic netlink {idx}: no service listens there", wanted)


def _await(is_there: Callable[[], bool], what: str, wanted: str) -> None:
    """A service that has just been started takes a moment. Raises CompanionError."""
    deadline_s = time.monotonic() + _PATIENCE_S
    while not is_there():
        if time.monotonic() > deadline_s:
            raise CompanionError(f"{what}; start the service first, with {wanted}")
        time.sleep(0.05)


def _no_connector(connector_idx: int, error: NetlinkError) -> CompanionError:
    return CompanionError(f"connector {connector_idx}: {error.strerror}; --unix SOCKET works without")
