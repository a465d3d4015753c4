"""What the vehicle says of its own arming checks, by bit, event and text."""

from __future__ import annotations

import pytest

from companion.autopilot import arming_events
from companion.autopilot.arming_checks import ArmingChecks
from companion.core.messages import FlightMode

_BIT = 1 << 28
_S = 1_000_000_000
_SUMMARY, _HEALTH_SUMMARY, _ACCEL_BIAS, _OFFBOARD_SIGNAL, _NO_STICKS = (
    27825120, 18691879, 20390844, 19865031, 17231145,
)  # fmt: skip
_HOLD, _OFFBOARD, _EVERY = 1 << 4, 1 << 14, 0xFFFFFFFF


def _checks(health: int = 0, present: int = 0, enabled: int = 0, told_ns: int = 0) -> ArmingChecks:
    checks = ArmingChecks()
    checks.status(present, enabled, health, told_ns)
    return checks


def _report(checks: ArmingChecks, *events: tuple[int, int, int]) -> None:
    checks.event(_SUMMARY, 8, 0)
    for event in events:
        checks.event(*event)
    checks.event(_HEALTH_SUMMARY, 8, 0)


@pytest.mark.parametrize("firmware", ["1.16.1", "1.12.3", "", "0.0.0"])
def test_the_bit_in_health_is_enough(firmware: str) -> None:
    assert _checks(_BIT).passed(firmware, 0) is True
    assert _checks(_BIT | 0x320883F, 0x200400F, 0x201400F).passed(firmware, 0) is True


@pytest.mark.parametrize(
    ("firmware", "passed"),
    [("1.16.1", False), ("1.14.0", False), ("2.0.0", False), ("", False), ("1.13.3", None), ("0.0.0", False)],
)
def test_without_the_bit_a_firmware_that_tells_has_failed(firmware: str, passed: bool | None) -> None:
    assert _checks(0xEFFFFFFF, 0xEFFFFFFF, 0xEFFFFFFF).passed(firmware, 0) is passed


@pytest.mark.parametrize("masks", [(_BIT, 0, 0), (0, _BIT, 0), (_BIT, _BIT, 0)])
def test_an_older_firmware_that_has_the_bit_tells_too(masks: tuple[int, int, int]) -> None:
    present, enabled, health = masks
    assert _checks(health, present, enabled).passed("1.13.3", 0) is False


@pytest.mark.parametrize("masks", [(0, _BIT, _BIT), (_BIT, 0, _BIT), (_BIT, _BIT, _BIT)])
def test_wherever_the_bit_was_it_is_told_from_then_on(masks: tuple[int, int, int]) -> None:
    checks = ArmingChecks()
    checks.status(*masks, 0)
    assert checks.passed("1.13.3", 0) is True
    checks.status(0, 0, 0, 0)
    assert checks.passed("1.13.3", 0) is False


def test_what_was_told_once_is_told_from_then_on() -> None:
    checks = _checks(_BIT)
    checks.status(0, 0, 0, 1)
    assert checks.passed("0.0.0", 1) is False


def test_silence_is_no_pass_and_says_so() -> None:
    nothing = ArmingChecks()
    assert nothing.passed("1.16.1", 0) is False and nothing.passed("1.13.3", 0) is False
    assert nothing.reasons(FlightMode.HOLD, 0) == ("it tells nothing of them (SYS_STATUS)",)
    once = _checks(_BIT, told_ns=5)
    assert once.passed("1.16.1", 5 + 3 * _S) is True and once.reasons(FlightMode.HOLD, 5 + 3 * _S) == ()
    young = _checks(0, told_ns=(1 << 33) - 1)
    assert young.passed("1.16.1", 1 << 33) is False and young.reasons(None, 1 << 33) == ()
    assert once.passed("1.16.1", 6 + 3 * _S) is False and len(once.reasons(FlightMode.HOLD, 6 + 3 * _S)) == 1


def test_reasons_are_the_errors_of_the_newest_report_that_concern_the_mode() -> None:
    checks = _checks()
    _report(checks, (_OFFBOARD_SIGNAL, 3, _OFFBOARD), (_NO_STICKS, 4, _EVERY), (_ACCEL_BIAS, 3, _EVERY))
    assert checks.reasons(FlightMode.HOLD, 0) == ("estimator high accel bias",)
    assert checks.reasons(FlightMode.OFFBOARD, 0) == ("modes offboard signal", "estimator high accel bias")
    assert checks.reasons(None, 0) == ("modes offboard signal", "estimator high accel bias")
    _report(checks, (_NO_STICKS, 4, _EVERY), (_OFFBOARD_SIGNAL, 3, _OFFBOARD))
    assert checks.reasons(FlightMode.HOLD, 0) == ("modes manual control",), "no error: whatever was found"
    _report(checks, (_NO_STICKS, 4, _EVERY), (_ACCEL_BIAS, 2, _EVERY), (25005055, 0, _EVERY))
    assert checks.reasons(FlightMode.HOLD, 0) == ("estimator high accel bias", "accel missing"), "worse than an error"
    _report(checks)
    assert checks.reasons(FlightMode.HOLD, 0) == ()


def test_a_check_of_another_version_is_shown_by_its_number_and_what_is_no_check_is_not() -> None:
    checks = _checks()
    checks.event(_ACCEL_BIAS, 3, _EVERY)
    assert checks.reasons(FlightMode.HOLD, 0) == (), "outside a report it is no finding"
    _report(checks, (16777299, 3, _HOLD))
    checks.event(_ACCEL_BIAS, 3, _EVERY)
    assert checks.reasons(FlightMode.HOLD, 0) == ("PX4's event 16777299",)


def test_texts_of_older_firmware_are_reasons_until_it_passes() -> None:
    checks = _checks()
    for text in ("Preflight Fail: High Accelerometer Bias", "Takeoff detected", "PREFLIGHT FAIL: Compass missing"):
        checks.text(2, text)
    checks.text(2, "Preflight Fail: High Accelerometer Bias")
    assert checks.reasons(FlightMode.HOLD, 0) == ("Compass missing", "High Accelerometer Bias")
    checks.text(2, "Preflight Fail:")
    assert checks.reasons(FlightMode.HOLD, 0)[-1] == "Preflight Fail:"
    checks.status(0, 0, _BIT, 1)
    checks.status(0, 0, 0, 2)
    assert checks.reasons(FlightMode.HOLD, 2) == ()


def test_no_more_than_three_are_shown_and_twenty_kept() -> None:
    checks = _checks()
    _report(checks, *((17000000 + number, 3, _EVERY) for number in range(40)))
    assert checks.reasons(FlightMode.HOLD, 0) == tuple(f"PX4's event {17000000 + number}" for number in (37, 38, 39))
    assert len(checks._found) == 20


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("commander_arming_check_summary", _SUMMARY),
        ("commander_health_summary", _HEALTH_SUMMARY),
        ("check_modes_offboard_signal", _OFFBOARD_SIGNAL),
        ("check_modes_manual_control", _NO_STICKS),
        ("check_modes_mission", 17154777),
        ("check_rc_dl_no_dllink", 23579003),
    ],
)
def test_numbers_of_events_are_those_of_a_real_px4(name: str, number: int) -> None:
    assert arming_events.event_number(name) == number
    assert "event" not in arming_events.words(number) or not name.startswith("check_")


@pytest.mark.parametrize(
    ("mode", "bit"),
    [
        (FlightMode.MISSION, 3), (FlightMode.HOLD, 4), (FlightMode.RETURN, 5), (FlightMode.OFFBOARD, 14),
        (FlightMode.TAKEOFF, 17), (FlightMode.LAND, 18), (FlightMode.MANUAL, 0), (FlightMode.MANUAL, 1),
        (FlightMode.MANUAL, 2), (FlightMode.MANUAL, 10), (FlightMode.MANUAL, 15),
    ],
)  # fmt: skip
def test_each_mode_has_its_bits(mode: FlightMode, bit: int) -> None:
    assert arming_events.concerns(1 << bit, mode) and not arming_events.concerns(1 << 20, mode)
    assert arming_events.concerns(1 << bit, None) and arming_events.concerns(1 << bit, FlightMode.OTHER)
    assert not arming_events.concerns(0, None)
