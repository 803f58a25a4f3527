"""Beam, air and axes: each state is reached, at its threshold, and left again."""

from math import isnan, nan

import pytest

from stepdiag_ros.devices.cnc import CncState
from stepdiag_ros.devices.interferometer import (
    STATUS_BEAM_LOST,
    STATUS_FAULT,
    STATUS_LOW_SIGNAL,
    STATUS_OK,
    STATUS_OVERSPEED,
)
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.run.device_health import (
    AIR_UNKNOWN,
    DIM,
    GOOD,
    NO_BEAM_NEEDED,
    NO_BEAM_YET,
    NO_COMPENSATED,
    NO_RAW,
    NOT_ASKED_FOR,
    WAS_LOST,
    Air,
    Axes,
    Beam,
    Compensation,
)
from stepdiag_ros.run.health import HOLD, UNKNOWN, WINDOW, HealthFinding, Level

SECOND = 1_000_000_000
STALE_AFTER = 2.0


class LaserBench:
    """A beam that is judged at one time, real and simulated the same."""

    def __init__(self):
        self.beam = Beam(STALE_AFTER, dim_below=0.2)
        self.time = 100.0
        self.beam.set_up(99 * SECOND)

    def read(self, status=STATUS_OK, signal=1.0, wait=0.1):
        self.time += wait
        reading = Reading(round(self.time * SECOND), 0, 0.0, 0.0, signal, status, Environment())
        return self.beam.take([reading], self.time)

    def judge(self, wait=0.0, in_run=True):
        self.time += wait
        return self.beam.judge(round(self.time * SECOND), self.time, in_run)


@pytest.fixture
def laser():
    return LaserBench()


def test_without_any_reading_no_run_can_begin(laser):
    laser.beam.begin(laser.time)
    finding = laser.judge(STALE_AFTER)
    assert finding.level is Level.STALE and not finding.forbids, "it may still come"
    finding = laser.judge(0.1)
    assert finding.level is Level.STALE and finding.forbids
    assert finding.values["age of the last reading (s)"] == UNKNOWN


def test_a_beam_goes_stale_when_readings_stop_and_comes_back(laser):
    laser.read()
    assert laser.judge().message == GOOD
    assert laser.judge(STALE_AFTER).level is Level.OK
    finding = laser.judge(0.01)
    assert finding.level is Level.STALE and finding.forbids
    assert finding.message == "no reading has come for more than 2 s"
    laser.read()
    finding = laser.judge()
    assert finding.level is Level.OK and not finding.forbids


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (STATUS_BEAM_LOST, "beam is lost"),
        (STATUS_OVERSPEED, "too fast"),
        (STATUS_FAULT, "fault of its own"),
        (99, "unknown status 99"),
    ],
)
def test_a_lost_beam_is_an_error_and_its_zero_stays_lost_until_the_next_setup(laser, status, words):
    laser.read()
    assert laser.read(status)
    finding = laser.judge()
    assert finding.level is Level.ERROR and words in finding.message
    # The run goes on with another attempt at the line: what forbids that is judged elsewhere.
    assert not finding.forbids
    assert not laser.read(status), "nothing has changed"
    assert laser.read(STATUS_OK)
    assert (laser.judge().level, laser.judge().message) == (Level.WARN, WAS_LOST)
    for _ in range(100):
        laser.read()
    assert laser.judge().message == WAS_LOST
    laser.beam.set_up(round(laser.time * SECOND))
    assert laser.judge().message == GOOD
    assert laser.judge().values["times lost since the start"] == "1"


def test_what_was_lost_before_a_setup_does_not_matter_to_it(laser):
    laser.beam.expect_setup()
    laser.read(STATUS_BEAM_LOST)
    assert laser.judge().message == NO_BEAM_YET
    laser.beam.set_up(round((laser.time + 1.0) * SECOND))
    laser.read(STATUS_BEAM_LOST)
    assert laser.judge().message == NO_BEAM_YET, "readings of before the setup still come"
    laser.read(wait=2.0)
    assert laser.judge().message == GOOD
    laser.read(STATUS_BEAM_LOST)
    laser.read()
    assert laser.judge().message == WAS_LOST
    assert laser.judge(in_run=False).message == GOOD


def test_outside_a_run_a_missing_beam_is_nothing_to_warn_of(laser):
    laser.read(STATUS_BEAM_LOST)
    finding = laser.judge(in_run=False)
    assert (finding.level, finding.message) == (Level.OK, NO_BEAM_NEEDED)


@pytest.mark.parametrize(("status", "signal"), [(STATUS_LOW_SIGNAL, 1.0), (STATUS_OK, 0.19)])
def test_a_dim_beam_is_told_for_a_while(laser, status, signal):
    laser.read(signal=0.2)
    assert laser.judge().message == GOOD, "the limit itself is bright enough"
    laser.read(status, signal)
    assert (laser.judge().level, laser.judge().message) == (Level.WARN, DIM)
    laser.read()
    assert laser.judge(HOLD - 0.2).message == DIM
    laser.read()
    assert laser.judge(0.3).message == GOOD


def test_signal_is_told_over_the_last_whole_window(laser):
    laser.judge()
    for signal in (1.0, 0.5, 0.3):
        laser.read(signal=signal)
    assert laser.judge().values["lowest signal of the last second (0..1)"] == UNKNOWN
    values = laser.judge(WINDOW).values
    assert values["lowest signal of the last second (0..1)"] == "0.3"
    assert values["mean signal of the last second (0..1)"] == "0.6"
    # An instrument that does not tell its signal.
    laser.read(signal=nan)
    values = laser.judge(WINDOW).values
    assert values["lowest signal of the last second (0..1)"] == UNKNOWN
    assert laser.judge().message == GOOD


def take_all(air, environment, time, real):
    for name, value in environment._asdict().items():
        air.take(name, value, time, real)


class TestAir:
    GOOD = Environment(20.0, 101325.0, 0.5, 20.1)

    def test_sensors_that_have_not_spoken(self):
        air = Air(10.0)
        assert air.judge(0, 0.0).level is Level.STALE
        air.take("air_temperature", 20.0, 0, 0.0)
        assert air.judge(0, 0.1).level is Level.STALE
        finding = air.judge(0, HOLD)
        assert finding.level is Level.ERROR
        assert "air pressure and relative humidity" in finding.message

    def test_all_known(self):
        air = Air(10.0)
        take_all(air, self.GOOD, SECOND, 1.0)
        finding = air.judge(SECOND, 1.0)
        assert finding.level is Level.OK and finding.values["air pressure (Pa)"] == "101325"

    def test_values_grow_old_and_are_known_again(self):
        air = Air(10.0)
        take_all(air, self.GOOD, SECOND, 1.0)
        assert air.judge(11 * SECOND, 11.0).level is Level.OK
        assert air.judge(11 * SECOND + 1, 11.1).level is Level.ERROR
        take_all(air, self.GOOD, 12 * SECOND, 12.0)
        assert air.judge(12 * SECOND, 12.0).level is Level.OK

    def test_one_sensor_that_is_silent_is_named(self):
        air = Air(10.0)
        take_all(air, self.GOOD, SECOND, 1.0)
        for name in ("air_temperature", "relative_humidity", "material_temperature"):
            air.take(name, getattr(self.GOOD, name), 15 * SECOND, 15.0)
        finding = air.judge(15 * SECOND, 15.0)
        assert finding.message == "air pressure is not known: readings are not compensated"

    @pytest.mark.parametrize(
        ("field", "value", "level"),
        [
            ("air_pressure", 1013.25, Level.ERROR),
            ("relative_humidity", 50.0, Level.ERROR),
            ("relative_humidity", 1.0, Level.OK),
            ("air_temperature", 293.15, Level.ERROR),
            ("air_temperature", 68.0, Level.ERROR),
            ("air_temperature", nan, Level.ERROR),
            ("material_temperature", nan, Level.WARN),
        ],
    )
    def test_a_value_of_another_unit_or_none(self, field, value, level):
        air = Air(10.0)
        take_all(air, self.GOOD._replace(**{field: value}), SECOND, 1.0)
        finding = air.judge(SECOND, 1.0)
        assert finding.level is level, finding
        assert level is Level.OK or field.replace("_", " ") in finding.message

    @pytest.mark.parametrize(
        ("field", "value", "words"),
        [
            ("air_pressure", 1013.25, "the air pressure is out of range: it would fit in hPa"),
            ("air_pressure", 760.0, "it would fit in hPa or mmHg"),
            ("air_pressure", 101.0, "it would fit in kPa"),
            ("relative_humidity", 50.0, "it would fit in per cent"),
            ("air_temperature", 293.15, "it would fit in K"),
            ("air_temperature", 68.0, "it would fit in degF"),
            ("material_temperature", -999.0, "the material temperature is out of range; it is not"),
        ],
    )
    def test_another_unit_is_guessed_in_words_and_the_value_is_not_used(self, field, value, words):
        air = Air(10.0)
        take_all(air, self.GOOD, SECOND, 1.0)
        assert air.known.at(SECOND) == self.GOOD
        air.take(field, value, 2 * SECOND, 2.0)
        assert words in air.judge(2 * SECOND, 2.0).message
        assert isnan(getattr(air.known.at(2 * SECOND), field))
        air.take(field, getattr(self.GOOD, field), 3 * SECOND, 3.0)
        assert air.judge(3 * SECOND, 3.0).level is Level.OK
        assert air.judge(3 * SECOND, 3.0).values["times not known since the start"] == "1"
        assert air.known.at(3 * SECOND) == self.GOOD


class TestCompensation:
    AIR = HealthFinding(Level.OK, "")

    def judged(self, kind, raw, compensated, air=AIR, status=STATUS_OK):
        compensation = Compensation(kind)
        compensation.take([Reading(1, 1, raw, compensated, 1.0, status, Environment())])
        for _ in range(Compensation.LOOKS - 1):
            assert not compensation.judge(air).forbids
        return compensation.judge(air)

    def test_readings_that_are_not_compensated_as_asked_for(self):
        assert self.judged("own", 1.0, 1.0).level is Level.OK
        assert self.judged("instrument", nan, 1.0).level is Level.OK
        assert self.judged("off", 1.0, 1.0).message == NOT_ASKED_FOR
        for finding, words in (
            (self.judged("own", nan, nan), NO_RAW),
            (self.judged("instrument", 1.0, nan), NO_COMPENSATED),
        ):
            assert finding.message == words and finding.forbids
        unknown = HealthFinding(Level.ERROR, "air pressure is not known")
        assert self.judged("instrument", 1.0, nan, unknown).message == AIR_UNKNOWN
        assert self.judged("own", 1.0, nan, unknown).message == AIR_UNKNOWN

    def test_an_instrument_that_did_its_part_is_not_blamed_for_a_gap_in_the_weather(self):
        compensation = Compensation("instrument")
        good = Reading(1, 1, 1.0, 1.0, 1.0, STATUS_OK, Environment())
        compensation.take([good, good._replace(compensated_displacement=nan)])
        for _ in range(10):
            finding = compensation.judge(self.AIR)
            assert finding.message == AIR_UNKNOWN and not finding.forbids

    def test_an_instrument_is_given_its_time_from_when_the_air_is_known(self):
        compensation = Compensation("instrument")
        raw = Reading(1, 1, 1.0, nan, 1.0, STATUS_OK, Environment())
        compensation.take([raw])
        for _ in range(3 * Compensation.LOOKS):
            assert not compensation.judge(
                HealthFinding(Level.STALE, "no sensor has spoken")
            ).forbids
        for _ in range(Compensation.LOOKS - 1):
            assert not compensation.judge(self.AIR).forbids
        assert compensation.judge(self.AIR).message == NO_COMPENSATED

    def test_without_a_beam_nothing_is_said(self):
        finding = self.judged("own", nan, nan, status=STATUS_BEAM_LOST)
        assert finding.level is Level.OK


class TestAxes:
    def judged(self, axes, state=CncState.READY, reason="", time=1.0):
        return axes.judge(state, reason, round(time * SECOND), time)

    def at(self, x):
        axes = Axes(2.0)
        axes.limit((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
        axes.take((x, 0.5, 0.5), SECOND, 1.0)
        return axes

    def test_no_position_yet(self):
        axes = Axes(2.0)
        axes.begin(1.0)
        assert not self.judged(axes, time=3.0).forbids
        finding = self.judged(axes, time=3.1)
        assert finding.level is Level.STALE and finding.forbids
        assert finding.values["position of X (m)"] == UNKNOWN

    def test_positions_go_stale_and_come_back(self):
        axes = self.at(0.5)
        assert self.judged(axes, time=3.0).level is Level.OK
        finding = self.judged(axes, time=3.1)
        assert finding.level is Level.STALE and finding.forbids
        assert finding.message == "no actual position has come for more than 2 s"
        axes.take((0.5, 0.5, 0.5), 4 * SECOND, 4.0)
        assert self.judged(axes, time=4.0).level is Level.OK

    def test_the_state_of_the_controller_is_told_in_words(self):
        axes = self.at(0.5)
        stopped = self.judged(axes, CncState.STOPPED, "stopped on request")
        assert stopped.level is Level.WARN and "stopped on request" in stopped.message
        faulty = self.judged(axes, CncState.FAULT, "servo alarm 401")
        assert faulty.level is Level.ERROR and "servo alarm 401" in faulty.message
        moving = self.judged(axes, CncState.MOVING)
        assert moving.says(self.judged(axes)), "a move is no news"
        assert moving.values["state"] == "moving"

    def test_a_machine_beyond_its_soft_limits(self):
        assert self.judged(self.at(1.0 + 1e-7)).level is Level.OK
        finding = self.judged(self.at(1.001))
        assert finding.level is Level.WARN and finding.message.endswith("in X")
        assert self.judged(self.at(-0.001)).level is Level.WARN


def test_axes_that_move_and_are_not_heard_are_told_unless_their_positions_are_rare():
    def silent_after(rate, seconds, limit=0.5):
        axes = Axes(2.0)
        axes.take((0.0, 0.0, 0.0), 0, 0.0)
        axes.moves(0.0)
        said = ""
        for step in range(round(seconds / 0.01) + 1):
            said = said or axes.silent(limit, rate, step * 10_000_000, step * 0.01)
        return said

    assert silent_after(50.0, 0.49) == ""
    assert silent_after(50.0, 0.52) == "the axes move, but no actual position has come for 0.5 s"
    assert silent_after(1.0, 2.9) == ""
    assert "for 3 s" in silent_after(1.0, 3.1)


def test_simulated_time_that_stands_still_is_no_silence_of_the_axes():
    axes = Axes(2.0)
    axes.take((0.0, 0.0, 0.0), 0, 0.0)
    axes.moves(0.0)
    assert not any(axes.silent(0.5, 50.0, 0, step * 0.01) for step in range(1000))
