"""CSI logs of both ends -> round-trip samples: which packets belong together, and what became of the others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.analysis.by_time import pair_by_card_time
from companion.analysis.runs import KNOWN_TRANSMITTERS
from companion.errors import CompanionError
from csi_bridge.clock import host_times_s
from csi_bridge.dat import CsiLog, read_dat
from csi_bridge.dat_frames import DatFileError
from csi_bridge.dat_wanted import Wanted
from csi_bridge.feitcsi.csi_log import is_feitcsi_file, read_csi_log
from csi_bridge.scaling import are_40mhz, without_spatial_mapping
from wsr.channel import centre_channel, pair_by_counter, pair_by_time, strongest_antenna
from wsr.ofdm import Grid, grid
from wsr.reduced import as_sent

UNPAIRED: Final = "unpaired"
DUPLICATE: Final = "duplicate counter"
WEAK: Final = "weak"
WIDE: Final = "40 MHz"

UNKNOWN_MAC: Final = "00:00:00:00:00:00"
"""What the driver writes when it did not know the sender."""

# The answer leaves 0.13 to 0.6 ms after the ping; the next ping follows after 2.8 ms at the earliest.
_MIN_LAG_S: Final = 0.0
_MAX_LAG_S: Final = 1.0e-3
# CSI parts are whole numbers: below one count there is quantisation and no signal.
_WEAK_COUNTS: Final = 1.0

# Round trips of one run have one lag, known to the mapped clocks to 0.05 ms in all recordings; those of two runs that
# count alike drift by 0.65 ms and more in such a time.
_LAG_WINDOW_S: Final = 1.5
_MAX_LAG_SPREAD_S: Final = 0.3e-3

Indices = npt.NDArray[np.intp]
Times = npt.NDArray[np.float64]


class ExchangeError(CompanionError):
    """The logs of a link cannot be joined; the message names the file and what is in it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Exchanges:
    """The usable round trips of one link, K of them, in the order of the receiver's log."""

    t_s: npt.NDArray[np.float64]
    """(K,) reception at the receiving robot on its host's wall clock."""
    tx_t_s: npt.NDArray[np.float64]
    """(K,) reception of the other half at the transmitter, on its own host's wall clock."""
    channel: npt.NDArray[np.complex128]
    """(K,) product of the channels of both directions at the channel centre: oscillator offsets cancel in it."""
    forward: npt.NDArray[np.complex64]
    """(K, 30) channel at the receiving robot, `reverse` at the transmitter as its datagrams would have brought it: what
    a recording gives is what the flight would have given (docs/wire.md)."""
    reverse: npt.NDArray[np.complex64]
    nic_us: npt.NDArray[np.float64]
    """(K, 2) unwrapped stamps of both cards, the receiving robot's first."""
    grid: Grid | None = None
    """Of both channels; None for a 5300's."""
    half_turns: bool = False
    packets: int
    """Records of this transmitter in the receiver's log."""
    dropped: dict[str, int]
    """How many of them are not used, by reason."""


@dataclass(frozen=True, slots=True, eq=False)
class PacketTimes:
    """Of one transmitter's packets, on the receiving robot's clock [s]: when it heard them (N,), those of them that are
    usable round trips (K,), and those of these that make its aperture (M,)."""

    heard_s: Times
    paired_s: Times = field(default_factory=lambda: np.empty(0))
    used_s: Times = field(default_factory=lambda: np.empty(0))


def read_log(path: Path, wanted: Wanted | None = None) -> CsiLog:
    """The log at `path`, of whichever card, or what is `wanted` of it, with its errors as the command line shows them.
    Raises ExchangeError."""
    try:
        return read_csi_log(path, wanted) if is_feitcsi_file(path) else read_dat(path, wanted)
    except DatFileError as error:
        raise ExchangeError(str(error)) from None


def damage(log: CsiLog) -> Iterator[str]:
    """Says what of the log could not be read."""
    if log.malformed_count or log.skipped_bytes:
        yield f"{log.path}: {log.malformed_count} malformed records, {log.skipped_bytes} bytes skipped"
    for kind, count in log.other_kinds.items():
        yield f"{log.path}: {count} records of {kind} are left out, most are of another format or width"


def senders(log: CsiLog) -> dict[str, int]:
    """Records by MAC, without those of unknown senders."""
    macs, counts = np.unique(log.mac, return_counts=True)
    known = zip(macs.tolist(), counts.tolist(), strict=True)
    return {mac: count for mac, count in known if mac not in ("", UNKNOWN_MAC)}


def own_card(name: str, given: str | None = None) -> str | None:
    """MAC of the transmitter `name` as far as it is known without a log: the given one, else a data set's."""
    return given or next((mac for mac, known_name in KNOWN_TRANSMITTERS.items() if known_name == name), None)


def transmitter_mac(name: str, rx: CsiLog, tx: CsiLog, given: str | None = None) -> str:
    """MAC of the transmitter `name`: the given one, else a known card's, else the one sender it can be.

    A log never holds packets of its own card, so the transmitter is a sender that its own log lacks.
    Raises ExchangeError when none or more than one is left, and where its own log holds its known card's packets.
    """
    heard = senders(rx)
    listed = ", ".join(heard) or "none"
    known = own_card(name, given)
    if known is not None and known in senders(tx):
        raise hears_itself(name, known, rx.path, tx.path, rx_heard_it=known in heard, given=given is not None)
    if known is not None and known in heard:
        return known
    if given is not None:
        raise ExchangeError(f"{rx.path}: no packets of {given}; senders heard: {listed}")
    others = sorted(heard.keys() - senders(tx).keys())
    if len(others) == 1:
        return others[0]
    if known is not None:
        raise ExchangeError(f"{rx.path}: no packets of {known} ({name}); senders heard: {listed}")
    raise ExchangeError(f"{rx.path}: which sender is {name}? Choose with --mac {name}=MAC; senders heard: {listed}")


def hears_itself(name: str, mac: str, rx: Path, tx: Path, *, rx_heard_it: bool, given: bool) -> ExchangeError:
    """Of a log `tx` that cannot be that of `name`, whose card is `mac`: known, or `given` by the user, who may err."""
    if given and not rx_heard_it:
        return ExchangeError(
            f"{rx}: no packets of {mac}, and {tx} holds some: is it the card of {name}, or are the ends swapped?"
        )
    seen = f"{tx} holds packets of {mac}, {name}'s own card, which that card's own log never does"
    if rx_heard_it:
        return ExchangeError(f"{seen}: is it another robot's log, as {rx} is?")
    return ExchangeError(f"the ends look swapped: {seen}, and {rx} holds none")


def receiver_mac(rx: CsiLog, tx: CsiLog) -> str:
    """MAC of the receiving robot: the sender in the transmitter's log that its own log lacks. Raises ExchangeError."""
    counts = senders(tx)
    others = {mac: count for mac, count in counts.items() if mac not in senders(rx)}
    if not others:
        raise ExchangeError(
            f"{tx.path}: no packets of the receiving robot; senders heard: {', '.join(counts) or 'none'}"
        )
    return max(others, key=lambda mac: others[mac])


def join(rx: CsiLog, tx: CsiLog, mac: str, reduced: bool = True) -> Exchanges:
    """Round trips with the transmitter `mac`: by frame counter where both logs have one, else by time.

    At each end the antenna with the most power is used. The transmitter's channels are `reduced` to what its datagrams
    would have brought, or as its card reported them. Raises ExchangeError, also for logs of different runs.
    """
    on = _common_grid(rx, tx)
    heard, answered = np.flatnonzero(rx.mac == mac), np.flatnonzero(tx.mac == receiver_mac(rx, tx))
    ours, theirs = heard[~are_40mhz(rx.rate[heard])], answered[~are_40mhz(tx.rate[answered])]
    if not len(ours) or not len(theirs):
        log = tx if len(ours) else rx
        raise ExchangeError(f"{log.path}: all its packets of this link are 40 MHz wide; estimates take those of 20 MHz")
    # One of 20 MHz here whose other half is 40 MHz wide goes with it.
    halved = np.isin(rx.frame_count[ours], np.setdiff1d(tx.frame_count[answered], tx.frame_count[theirs]))
    halved &= rx.frame_count[ours] >= 0
    ours = ours[~halved]
    dropped = {WIDE: len(heard) - len(ours)}
    if np.all(rx.frame_count[ours] >= 0) and np.all(tx.frame_count[theirs] >= 0):
        i, j = pair_by_counter(rx.frame_count[ours], tx.frame_count[theirs])
        dropped[DUPLICATE] = _duplicates(rx.frame_count[ours], tx.frame_count[theirs])
    elif rx.fine_us is not None and tx.fine_us is not None:
        i, j = pair_by_card_time(rx.fine_us[ours], tx.fine_us[theirs])
    else:
        # Ping first: the transmitter hears it before the receiver hears the answer. Host clocks agree in such logs.
        j, i = pair_by_time(tx.host_time_s[theirs], rx.host_time_s[ours], _MIN_LAG_S, _MAX_LAG_S)
    dropped[UNPAIRED] = len(ours) - len(i) - dropped.get(DUPLICATE, 0)
    if len(i) == 0 and dropped[WIDE]:
        raise ExchangeError(f"{rx.path.name} and {tx.path.name}: every exchange has a half that is 40 MHz wide")
    if len(i) == 0:
        _refuse_several_runs(rx, ours)
        _refuse_several_runs(tx, theirs)
        why = "every frame counter is there twice" if len(ours) == dropped.get(DUPLICATE) else "not of the same run?"
        raise ExchangeError(f"{rx.path.name} and {tx.path.name} have no exchange in common: {why}")
    t_s = host_times_s(rx.timestamp_low_us, rx.host_time_s)[ours[i]]
    tx_t_s = host_times_s(tx.timestamp_low_us, tx.host_time_s)[theirs[j]]
    _check_same_run(rx, t_s, tx, tx_t_s)
    forward, reverse = _strongest(rx, ours, i), _strongest(tx, theirs, j)
    if reduced:
        reverse = as_sent(reverse, on)
    centre_forward, centre_reverse = centre_channel(forward, on), centre_channel(reverse, on)
    strong = (np.abs(centre_forward) >= _WEAK_COUNTS) & (np.abs(centre_reverse) >= _WEAK_COUNTS)
    stamps_us = np.stack([_stamps_us(rx)[ours[i]], _stamps_us(tx)[theirs[j]]], axis=1)
    dropped[WEAK] = int(np.count_nonzero(~strong))
    if not np.any(strong):
        log = rx if not np.any(np.abs(centre_forward) >= _WEAK_COUNTS) else tx
        raise ExchangeError(f"{log.path}: the CSI of all {len(i)} packets is zero: the card measured nothing")
    return Exchanges(
        t_s=t_s[strong],
        tx_t_s=tx_t_s[strong],
        channel=(centre_forward * centre_reverse)[strong],
        forward=forward[strong],
        reverse=reverse[strong],
        nic_us=stamps_us[strong] if on is not None else np.unwrap(stamps_us, axis=0, period=float(1 << 32))[strong],
        packets=len(heard),
        dropped={reason: count for reason, count in dropped.items() if count},
        grid=on,
        half_turns=on is not None,
    )


def _refuse_several_runs(log: CsiLog, link: Indices) -> None:
    """Raises ExchangeError where counters begin again, as they do in logs of two runs that were joined end to end."""
    counters = log.frame_count[link]
    _, first, inverse = np.unique(counters, return_index=True, return_inverse=True)
    repeated = first[inverse[1:]] < np.arange(1, len(link))
    again = np.flatnonzero((np.diff(counters) < 0) & (counters[1:] >= 0) & repeated)
    if len(again):
        after = again[0] + 1
        raise ExchangeError(
            f"{log.path} holds more than one run, or one twice: the frame counters of {log.mac[link[after]]} begin "
            f"again at {counters[after]} after {counters[after - 1]}; keep only the part of this run"
        )


def _common_grid(rx: CsiLog, tx: CsiLog) -> Grid | None:
    """Of the subcarriers of both logs; None for a 5300's. Raises ExchangeError where they differ."""
    if rx.subcarrier_hz is None and tx.subcarrier_hz is None:
        return None
    if rx.subcarrier_hz is None or tx.subcarrier_hz is None or not np.array_equal(rx.subcarrier_hz, tx.subcarrier_hz):
        raise ExchangeError(
            f"{rx.path.name} and {tx.path.name} are of different cards or widths: the two directions of an exchange "
            "can be joined only over the same subcarriers"
        )
    return grid(rx.subcarrier_hz)


def _stamps_us(log: CsiLog) -> npt.NDArray[np.float64]:
    return log.timestamp_low_us.astype(np.float64) if log.fine_us is None else log.fine_us


def heard_s(rx: CsiLog, mac: str) -> Times:
    """(N,) when the receiving robot heard `mac`, as in `Exchanges.t_s`, paired or not; less those of unknown time."""
    t_s: Times = host_times_s(rx.timestamp_low_us, rx.host_time_s)[rx.mac == mac]
    return np.compress(np.isfinite(t_s), t_s)


def _check_same_run(rx: CsiLog, t_rx_s: Times, tx: CsiLog, t_tx_s: Times) -> None:
    """Every run counts from 1, so that counters alone would pair any two. Drift and steps of the host clocks are
    allowed for: what must be steady is the lag within a short time."""
    lag_s = t_rx_s - t_tx_s
    window = np.floor((t_rx_s - t_rx_s.min()) / _LAG_WINDOW_S)
    windows = [lag_s[window == number] for number in np.unique(window)]
    spread_s = float(np.median(np.abs(np.concatenate([lags - np.median(lags) for lags in windows]))))
    if spread_s > _MAX_LAG_SPREAD_S:
        raise ExchangeError(
            f"{rx.path.name} and {tx.path.name} are not of the same run: their common counters are "
            f"{np.median(lag_s):.1f} s apart, spread by {1e3 * spread_s:.2f} ms within {_LAG_WINDOW_S} s, expected "
            f"below {1e3 * _MAX_LAG_SPREAD_S:.1f} (durations {np.ptp(t_rx_s):.2f} s and {np.ptp(t_tx_s):.2f} s)"
        )


def _strongest(log: CsiLog, link: Indices, chosen: Indices) -> npt.NDArray[np.complex64]:
    """CSI (K, 30) of the antenna that has the most power over the whole link."""
    csi = _first_antenna(log, link)
    return csi[chosen, :, strongest_antenna(csi)]


def _first_antenna(log: CsiLog, link: Indices) -> npt.NDArray[np.complex64]:
    """CSI (N, 30, R) of the sender's first antenna, where it mixed several over its streams."""
    csi = log.csi[link, :, :, 0]
    mixed = np.flatnonzero(log.n_tx[link] > 1)
    for rate, n_tx in set(zip(log.rate[link][mixed].tolist(), log.n_tx[link][mixed].tolist(), strict=True)):
        same = mixed[(log.rate[link][mixed] == rate) & (log.n_tx[link][mixed] == n_tx)]
        csi[same] = without_spatial_mapping(log.csi[link[same], :, :, :n_tx], rate)[..., 0]
    return csi


def _duplicates(ours: npt.NDArray[np.int64], theirs: npt.NDArray[np.int64]) -> int:
    repeated = [values[counts > 1] for values, counts in (np.unique(c, return_counts=True) for c in (ours, theirs))]
    return int(np.count_nonzero(np.isin(ours, np.concatenate(repeated))))
