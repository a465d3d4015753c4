"""Signatures by one end, judged by the other: pymavlink is the vehicle, and hypothesis the stranger."""

from __future__ import annotations

import random
import secrets
import time

from hypothesis import given
from hypothesis import strategies as st

from companion.signing.frames import Counts, FrameStream, Signing, frames_of
from companion.signing.relay import now_units
from tests.faults.campaigns import FULL
from tests.signed_link import Vehicle, setpoint

KEY = secrets.token_bytes(32)
FORGERIES = 1_000_000 if FULL else 100_000


def link(key: bytes = KEY, **state: object) -> Signing:
    return Signing(key, state.get("windows", {}), state.get("sent", 0), now_units)  # type: ignore[arg-type]


def test_the_vehicle_takes_what_is_signed_and_nothing_else() -> None:
    ours, vehicle = link(), Vehicle(KEY)
    frame = setpoint(7)
    assert vehicle.read(frame) == []
    signed = ours.sign(frame)
    assert signed is not None and len(signed) == len(frame) + 13
    (taken,) = vehicle.read(signed)
    assert (taken.get_type(), taken.time_boot_ms, taken.x, taken.yaw) == ("SET_POSITION_TARGET_LOCAL_NED", 7, 1.0, 0.5)
    assert vehicle.read(signed) == [], "the same frame again"
    assert Vehicle(secrets.token_bytes(32)).read(signed) == []


def test_what_cannot_be_signed_is_counted() -> None:
    ours = link()
    frame = setpoint(1)
    signed = ours.sign(frame)
    unknown = frame[:7] + b"\xff\xff\xff" + frame[10:]
    v1 = bytes(Vehicle(None).mav.heartbeat_encode(2, 12, 81, 0, 3).pack(Vehicle(None).mav, force_mavlink1=True))
    assert signed is not None
    assert [ours.sign(one) for one in (signed, unknown, v1, b"", b"\xfd")] == [None] * 5
    assert ours.counts.unsent == 5


def test_our_times_rise_whatever_the_clock_says() -> None:
    ours = Signing(KEY, {}, 5_000_000_000_000_000 // 100, lambda: 10)
    times = []
    for number in range(5):
        signed = ours.sign(setpoint(number))
        assert signed is not None
        times.append(int.from_bytes(signed[-12:-6], "little"))
    assert times == sorted(set(times)) and times[0] > 5_000_000_000_000_000 // 100


def test_the_vehicles_frames_are_taken_once() -> None:
    ours, vehicle = link(), Vehicle(KEY)
    frames = [vehicle.frame(number) for number in range(100)]
    assert all(ours.takes(frame) for frame in frames)
    assert not any(ours.takes(frame) for frame in frames)
    assert not any(ours.takes(Vehicle(None).frame(n)) for n in range(10))
    assert ours.counts == Counts(taken=100, used=100, unsigned=10)


def test_a_window_of_before_refuses_what_was_recorded() -> None:
    ours, vehicle = link(), Vehicle(KEY)
    frames = [vehicle.frame(number) for number in range(10)]
    assert all(map(ours.takes, frames))
    after = link(windows=ours.windows(), sent=ours.sent)
    assert not any(map(after.takes, frames)) and after.takes(vehicle.frame(11))
    assert after.sent > ours.sent


def test_of_100_000_forged_or_unsigned_frames_none_is_taken_and_the_vehicle_still_is() -> None:
    """Forged: another key, a changed byte, a recorded frame, a time in the far future, no signature, noise."""
    ours, vehicle, chance = link(), Vehicle(KEY), random.Random(3)
    stranger = Vehicle(secrets.token_bytes(32), timestamp=now_units() + 10**9)
    recorded = [vehicle.frame(number) for number in range(50)]
    assert all(map(ours.takes, recorded))
    plain, taken = Vehicle(None), 0
    begun_s = time.perf_counter()
    for number in range(FORGERIES):
        match number % 5:
            case 0:
                frame = stranger.frame(number)
            case 1:
                changed = bytearray(chance.choice(recorded))
                changed[-12:-6] = (now_units() + number).to_bytes(6, "little")
                frame = bytes(changed)
            case 2:
                frame = chance.choice(recorded)
            case 3:
                frame = plain.frame(number)
            case _:
                changed = bytearray(vehicle.frame(number))
                changed[chance.randrange(1, len(changed))] ^= 1 << chance.randrange(8)
                frame = bytes(changed)
        taken += sum(map(ours.takes, [frame]))
    seconds = time.perf_counter() - begun_s
    assert taken == 0
    assert ours.takes(vehicle.frame(1)), "a forged time has not moved its window"
    counts = ours.counts
    assert counts.wrong + counts.used + counts.unsigned == FORGERIES
    print(f"{FORGERIES} forgeries made and judged in {seconds:.1f} s: {counts}")


@given(st.lists(st.binary(max_size=40), max_size=6), st.integers(1, 60))
def test_frames_are_found_in_a_stream_with_noise_in_pieces_of_any_size(noise: list[bytes], size: int) -> None:
    vehicle = Vehicle(KEY)
    frames = [vehicle.frame(number) for number in range(len(noise) + 1)]
    # Noise that begins a frame may swallow what follows: here it has no byte that does.
    clean = [bytes(byte for byte in one if byte not in (0xFD, 0xFE)) for one in noise]
    data = b"".join(part for pair in zip(clean, frames, strict=False) for part in pair) + frames[-1]
    stream, found = FrameStream(), []
    for at in range(0, len(data), size):
        found += stream.feed(data[at : at + size])
    assert found == frames


@given(st.binary(max_size=600))
def test_any_bytes_are_no_frames_and_raise_nothing(data: bytes) -> None:
    stream = FrameStream()
    ours = link()
    for frame in (*frames_of(data), *stream.feed(data)):
        assert not ours.takes(frame)


def test_a_frame_that_noise_has_swallowed_is_found_again() -> None:
    vehicle = Vehicle(KEY)
    frames = [vehicle.frame(number) for number in range(12)]
    found = FrameStream().feed(b"\xfd\x40\x01" + b"".join(frames))
    assert found == frames
