"""What a log of CSI holds, of whichever card, told by its content."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.errors import CompanionError
from csi_bridge.dat import CsiLog, read_dat
from csi_bridge.dat_frames import DatFileError
from csi_bridge.feitcsi.channel import channel
from csi_bridge.feitcsi.clock import fine_us, unwrapped_us
from csi_bridge.feitcsi.log import FeitLog, is_feitcsi, parse_log
from csi_bridge.feitcsi.records import FeitRecord
from csi_bridge.foreign import foreign_format
from csi_bridge.records import CSI_CODE, MPDU_CODE
from csi_bridge.regular_file import read_regular
from csi_bridge.scaling import is_40mhz, subcarrier_hz

_FIRST_BYTES: Final = 4096
_FEITCSI: Final = "a FeitCSI log"
_GAP_PERIODS: Final = 5.0
_RESET_US: Final = -500_000
_S_PER_US: Final = 1e-6

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LogClock:
    """One clock of a log: how long it ran from the first record to the last, and how often it was set back."""

    name: str
    resolution_s: float
    span_s: float
    resets: int


@dataclass(frozen=True, slots=True, eq=False)
class Amplitudes:
    """|h| (N, S) of the strongest antenna over times (N,) [s] and frequencies (S,) [Hz]: the usual kind of record."""

    antenna: str
    t_s: Array
    subcarrier_hz: Array
    amplitude: npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CsiContent:
    """What a log holds."""

    path: Path
    format: str
    whole: int
    damaged: int
    skipped_bytes: int
    cut_off_bytes: int
    """Of a record that the end of the file cuts off."""
    senders: dict[str, int]
    antennas: dict[str, float]
    """Median power [dBm] by antenna, of those that have any."""
    kinds: dict[str, int]
    """Records by format and width."""
    widths_mhz: tuple[int, ...]
    subcarriers: tuple[int, ...]
    clocks: tuple[LogClock, ...]
    t_s: Array
    """(N,) when each record came, from the first, by the clock that tells best."""
    picture: Amplitudes
    notes: tuple[str, ...] = field(default=())

    @property
    def span_s(self) -> float:
        return float(self.t_s[-1] - self.t_s[0])

    @property
    def rate_hz(self) -> float | None:
        """Mean, None where all came at once."""
        return (self.whole - 1) / self.span_s if self.span_s > 0 else None

    @property
    def gaps(self) -> tuple[int, float]:
        """How many waits were longer than five usual ones, and the longest [s]."""
        waits = np.diff(self.t_s)
        if not len(waits):
            return 0, 0.0
        return int(np.count_nonzero(waits > _GAP_PERIODS * np.median(waits))), float(waits.max())


def read_content(path: Path) -> CsiContent:
    """Raises CompanionError for a file that cannot be read or is no log of CSI; the message says what it is instead."""
    try:
        data = read_regular(path)
    except OSError as error:
        raise CompanionError(f"{path}: {error.strerror}") from None
    is_other, nothing_whole = foreign_format(data[:_FIRST_BYTES]), ""
    if is_other.startswith(_FEITCSI) or not is_other:
        if is_feitcsi(data):
            if (log := parse_log(data, path)).records:
                return _of_feitcsi(log)
            nothing_whole = log.without_record
    elif data[2:3] not in (bytes([CSI_CODE]), bytes([MPDU_CODE])):
        # An archive may well hold records that can be found in it: the few that were not packed.
        raise CompanionError(f"{path}: no CSI log that can be read: {is_other}")
    try:
        return _of_5300(read_dat(path))
    except DatFileError as error:
        raise CompanionError(nothing_whole or str(error)) from None


def as_json(content: CsiContent) -> dict[str, object]:
    count, longest_s = content.gaps
    return {
        "file": str(content.path),
        "format": content.format,
        "records": {
            "whole": content.whole,
            "damaged": content.damaged,
            "cut_off": int(content.cut_off_bytes > 0),
            "skipped_bytes": content.skipped_bytes,
            "cut_off_bytes": content.cut_off_bytes,
        },
        "kinds": content.kinds,
        "senders": content.senders,
        "antennas": {name: round(power, 1) for name, power in content.antennas.items()},
        "widths_mhz": list(content.widths_mhz),
        "subcarriers": list(content.subcarriers),
        "rate_hz": content.rate_hz,
        "gaps": {"count": count, "longest_s": longest_s},
        "clocks": [
            {"name": c.name, "resolution_s": c.resolution_s, "span_s": c.span_s, "resets": c.resets}
            for c in content.clocks
        ],
        "span_s": content.span_s,
    }


def lines(content: CsiContent) -> list[str]:
    """For a person."""
    count, longest_s = content.gaps
    damage = f", {content.damaged} damaged ({content.skipped_bytes} bytes passed over)" if content.damaged else ""
    cut = f", one cut off by the end of the file ({content.cut_off_bytes} bytes of it)" if content.cut_off_bytes else ""
    rate = "all at once" if content.rate_hz is None else f"{content.rate_hz:.1f} a second over {content.span_s:.2f} s"
    gaps = f"{count} gaps, the longest {longest_s:.3f} s" if count else f"no gaps, at most {longest_s:.3f} s apart"
    return [
        f"{content.path}: {content.format}",
        f"  records      {content.whole} whole{damage}{cut}",
        f"  of           {_listed(content.kinds)}; subcarriers: {', '.join(map(str, content.subcarriers))}",
        f"  senders      {_listed(content.senders) or 'not recorded'}",
        f"  antennas     {', '.join(f'{name} {power:.0f} dBm' for name, power in content.antennas.items()) or 'none'}",
        f"  rate         {rate}; {gaps}",
        *(f"  clock        {_told(clock)}" for clock in content.clocks),
    ]


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items())


def _told(clock: LogClock) -> str:
    resets = f", set back {clock.resets} times" if clock.resets else ""
    return f"{clock.name}, steps of {1e9 * clock.resolution_s:g} ns, over {clock.span_s:.3f} s{resets}"


def _of_feitcsi(log: FeitLog) -> CsiContent:
    records = log.records
    stamps = np.array([record.timestamp_low_us for record in records], np.uint32)
    fine = fine_us(np.array([record.ftm_ticks for record in records], np.uint32), stamps) * _S_PER_US
    coarse, host = unwrapped_us(stamps) * _S_PER_US, np.array([record.host_time_us for record in records]) * _S_PER_US
    clocks = [_clock("card", 1e-6, coarse), _clock("card, fine", 3.125e-9, fine)]
    if host.all():
        clocks.append(_clock("host", 1e-6, host))
    kinds = Counter(str(record.rate) for record in records)
    usual = max(kinds, key=lambda name: kinds[name])
    shown = [number for number, record in enumerate(records) if str(record.rate) == usual]
    power = {"AB"[side]: [record.rssi_dbm[side] for record in records if record.rssi_dbm[side]] for side in (0, 1)}
    antennas = {name: float(np.median(values)) for name, values in power.items() if values}
    strongest = max(antennas, key=lambda name: antennas[name], default="A")
    amplitude = [np.abs(channel(records[number])[:, _row(records[number], strongest), 0]) for number in shown]
    return CsiContent(
        path=log.path,
        format="FeitCSI (AX200, AX210; hardware unverified)",
        whole=len(records),
        damaged=log.damaged_count,
        skipped_bytes=log.skipped_bytes,
        cut_off_bytes=log.truncated_bytes,
        senders=_counted([record.mac.hex(":").upper() for record in records]),
        antennas=antennas,
        kinds=dict(kinds),
        widths_mhz=tuple(sorted({record.rate.width_mhz or 0 for record in records})),
        subcarriers=tuple(sorted({len(record.csi) for record in records})),
        clocks=tuple(clocks),
        t_s=_since_first(fine),
        picture=Amplitudes(strongest, _since_first(fine)[shown], records[shown[0]].subcarrier_hz, np.array(amplitude)),
    )


def _row(record: FeitRecord, antenna: str) -> int:
    """Of the antenna among those that a record has; the first where it is not one of them."""
    number = "AB".index(antenna)
    return record.antennas.index(number) if number in record.antennas else 0


def _of_5300(log: CsiLog) -> CsiContent:
    if not len(log):
        raise CompanionError(f"{log.path}: frames and no CSI in it")
    card = unwrapped_us(log.timestamp_low_us) * _S_PER_US
    clocks = [_clock("card", 1e-6, card)]
    t_s = card
    if np.isfinite(log.host_time_s).all():
        clocks.append(_clock("host", 1e-6, log.host_time_s))
        t_s = card if clocks[0].resets == 0 else log.host_time_s
    wide = np.array([is_40mhz(int(rate)) for rate in log.rate])
    heard = np.where(log.rssi > 0, log.rssi - 44.0 - log.agc[:, None].astype(np.float64), np.nan)
    antennas = {
        name: float(np.nanmedian(heard[:, side]))
        for side, name in enumerate("ABC")
        if np.isfinite(heard[:, side]).any()
    }
    strongest = int(np.argmax(np.square(np.abs(log.csi[..., 0])).sum(axis=(0, 1))))
    shown = wide if wide.mean() > 0.5 else ~wide
    layouts = ", ".join(map(str, sorted(set(log.layout.tolist()))))
    hz = subcarrier_hz(int(log.rate[np.flatnonzero(shown)[0]]))
    return CsiContent(
        path=log.path,
        format=f"Intel 5300, header of {layouts} bytes",
        whole=len(log),
        damaged=log.malformed_count,
        skipped_bytes=log.skipped_bytes,
        cut_off_bytes=log.truncated_bytes,
        senders=_counted([mac for mac in log.mac.tolist() if mac]),
        antennas=antennas,
        kinds=_counted([f"{'40' if is_wide else '20'} MHz" for is_wide in wide.tolist()]),
        widths_mhz=tuple(sorted({40 if is_wide else 20 for is_wide in wide.tolist()})),
        subcarriers=(log.csi.shape[1],),
        clocks=tuple(clocks),
        t_s=_since_first(t_s),
        picture=Amplitudes("ABC"[strongest], _since_first(t_s)[shown], hz, np.abs(log.csi[shown, :, strongest, 0])),
    )


def _counted(names: list[str]) -> dict[str, int]:
    return dict(Counter(names).most_common())


def _since_first(t_s: npt.NDArray[np.floating]) -> Array:
    """What a clock that was set back leaves out, nothing tells."""
    return np.concatenate([[0.0], np.cumsum(np.maximum(np.diff(t_s), 0.0))])


def _clock(name: str, resolution_s: float, t_s: npt.NDArray[np.floating]) -> LogClock:
    steps = np.diff(t_s)
    return LogClock(name, resolution_s, float(t_s[-1] - t_s[0]), int(np.count_nonzero(steps < _RESET_US * _S_PER_US)))
