"""Ages, rates, gaps and clocks: each state is reached, at its threshold, and left again."""

from math import nan

import pytest

from stepdiag_ros.run.health import (
    HOLD,
    UNKNOWN,
    WINDOW,
    Age,
    Clockwork,
    Gaps,
    Level,
    SetBack,
    StampRate,
    figure,
)

SECOND = 1_000_000_000


def test_what_is_not_known_is_said_to_be_unknown_never_zero():
    assert figure(nan) == figure(None) == UNKNOWN
    assert figure(0.0) == "0" and figure(123456789) == "123456789" and figure(0.12345) == "0.1235"


def test_data_grows_old_only_if_ros_time_and_real_time_both_say_so():
    age = Age()
    assert age.at(SECOND, 1.0) != age.at(SECOND, 1.0)  # NaN before the first
    age.take(10 * SECOND, 100.0)
    assert age.at(12 * SECOND, 102.0) == pytest.approx(2.0)
    # A simulated clock that hurries, and one that stands still while the computer is busy.
    assert age.at(40 * SECOND, 100.5) == pytest.approx(0.5)
    assert age.at(10 * SECOND, 130.0) == 0.0
    # A stamp of the future is new, but for a clock that was set back.
    assert age.at(9 * SECOND, 130.0) == 0.0
    assert age.at(8 * SECOND, 130.0) == pytest.approx(30.0)


def test_a_clock_that_is_set_back_is_noticed_once_and_one_that_is_set_forward_is_not():
    clock = SetBack()
    looks = [100.0, 101.0, 100.95, 101.1, 5.0, 6.0, 900.0, 899.0]
    found = [clock.look(round(time * SECOND)) for time in looks]
    assert found == pytest.approx([0.0, 0.0, 0.0, 0.0, 96.1, 0.0, 0.0, 1.0])


class TestRate:
    def fed(self, hertz, asked, tolerance=0.1, seconds=2):
        rate = StampRate(asked, tolerance)
        finding = rate.judge(0.0)
        for number in range(int(hertz * seconds) + 1):
            time = number / hertz
            rate.take(1, round(time * SECOND))
            finding = rate.judge(time)
        return finding

    def test_before_the_first_window_nothing_can_be_told(self):
        assert StampRate(100.0, 0.1).judge(0.0).level is Level.STALE

    @pytest.mark.parametrize(
        ("hertz", "level"),
        [(100.0, Level.OK), (91.0, Level.OK), (89.0, Level.WARN), (109.0, Level.OK)],
    )
    def test_the_tolerance_is_where_it_is_said_to_be(self, hertz, level):
        finding = self.fed(hertz, 100.0)
        assert finding.level is level, finding
        assert float(finding.values["readings a second (Hz)"]) == pytest.approx(hertz, rel=0.02)

    def test_too_many_are_told_too(self):
        finding = self.fed(120.0, 100.0)
        assert finding.level is Level.WARN and "more" in finding.message

    def test_nobody_need_ask_for_a_rate(self):
        finding = self.fed(50.0, nan)
        assert finding.level is Level.OK and finding.values["asked for (Hz)"] == UNKNOWN

    def test_the_rate_is_that_of_ros_time_however_the_readings_come(self):
        """A thousand a simulated second, ten simulated seconds in a real one, in heaps."""
        rate = StampRate(1000.0, 0.1)
        for heap in range(40):
            rate.take(500, (heap + 1) * SECOND // 2)
            finding = rate.judge(heap * 0.05)
        assert finding.level is Level.OK
        assert float(finding.values["readings a second (Hz)"]) == pytest.approx(1000.0, rel=0.01)

    def test_it_recovers(self):
        rate = StampRate(10.0, 0.1)
        levels = []
        time = 0.0
        for period in (0.1, 0.2, 0.1):
            for _ in range(int(3.0 / period)):
                time += period
                rate.take(1, round(time * SECOND))
                finding = rate.judge(time)
            levels.append(finding.level)
        assert levels == [Level.OK, Level.WARN, Level.OK]

    def test_a_stream_that_stops_has_no_rate(self):
        rate = StampRate(10.0, 0.1)
        for number in range(30):
            rate.take(1, number * SECOND // 10)
            rate.judge(number * 0.1)
        rate.judge(3.0 + WINDOW)
        assert rate.judge(3.0 + 2 * WINDOW).level is Level.STALE


class TestGaps:
    def test_what_is_missing_is_counted_with_the_first_and_the_last(self):
        gaps = Gaps()
        assert gaps.judge(True, 0.0).level is Level.OK
        for place, number in enumerate((5, 6, 9, 10, 12)):
            gaps.take(number, place * SECOND, float(place))
        finding = gaps.judge(True, 4.0)
        assert finding.level is Level.WARN
        assert finding.message == "3 readings are missing, all between numbers 7 and 11"
        values = finding.values
        assert (values["missing"], values["first missing"], values["last missing"]) == (
            "3",
            "7",
            "11",
        )

    def test_one_is_named(self):
        gaps = Gaps()
        gaps.take(1, 0, 0.0)
        gaps.take(3, SECOND, 1.0)
        assert gaps.judge(True, 1.0).message == "reading 2 is missing"

    def test_it_is_told_for_the_whole_run_and_outside_one_for_a_while(self):
        gaps = Gaps()
        gaps.take(1, 0, 0.0)
        gaps.take(3, SECOND, 1.0)
        assert gaps.judge(True, 1000.0).level is Level.WARN
        assert gaps.judge(False, 1.0 + HOLD).level is Level.WARN
        after = gaps.judge(False, 1.1 + HOLD)
        assert after.level is Level.OK and "before: reading 2" in after.message
        gaps.begin()
        gaps.take(4, 2 * SECOND, 2000.0)
        finding = gaps.judge(True, 2000.0)
        assert (finding.level, finding.message) == (Level.OK, "no reading is missing")

    def test_late_and_repeated_ones_are_no_gaps(self):
        gaps = Gaps()
        for number, time in ((1, 1), (2, 2), (2, 2), (1, 1), (3, 3)):
            gaps.take(number, time * SECOND, float(time))
        finding = gaps.judge(True, 3.0)
        assert finding.message == "2 readings came late or twice"
        assert finding.values["missing"] == "0"

    def test_numbers_that_begin_anew_mean_another_zero(self):
        gaps = Gaps()
        for number, time in ((100, 1), (101, 2), (0, 3), (1, 4)):
            gaps.take(number, time * SECOND, float(time))
        finding = gaps.judge(True, 4.0)
        assert finding.level is Level.WARN and "started again" in finding.message
        assert finding.values["missing"] == "0"


class TestClockwork:
    def looked(self, clock, *looks):
        return [clock.judge(round(now * SECOND), real) for now, real in looks][-1]

    def test_even_time_is_well(self):
        assert self.looked(Clockwork(False), (100, 1), (101, 2), (102.05, 3)).level is Level.OK

    @pytest.mark.parametrize(("step", "way"), [(0.2, "forward"), (-0.2, "back")])
    def test_a_step_is_told_for_a_while(self, step, way):
        clock = Clockwork(False)
        finding = self.looked(clock, (100, 1), (101 + step, 2))
        assert finding.level is Level.WARN and way in finding.message
        assert float(finding.values["last step (s)"]) == pytest.approx(step)
        later = 2 + Clockwork.REMEMBERED
        assert self.looked(clock, (101 + step + later - 2, later)).level is Level.WARN
        assert self.looked(clock, (102 + step + later - 2, later + 1)).level is Level.OK

    def test_a_small_step_is_what_a_time_service_does(self):
        step = 0.9 * Clockwork.LARGEST_STEP
        assert self.looked(Clockwork(False), (100, 1), (101 + step, 2)).level is Level.OK

    def test_simulated_time_may_run_at_any_pace_but_not_back(self):
        clock = Clockwork(True)
        assert self.looked(clock, (100, 1), (200, 2), (200.1, 3)).level is Level.OK
        finding = self.looked(clock, (150, 4))
        assert finding.level is Level.WARN and "back" in finding.message

    def test_simulated_time_that_nobody_tells_is_waited_for(self):
        clock = Clockwork(True)
        assert clock.judge(0, 1.0).level is Level.OK
        assert clock.judge(0, 1.0 + Clockwork.STANDSTILL).level is Level.OK
        finding = clock.judge(0, 1.1 + Clockwork.STANDSTILL)
        assert finding.level is Level.STALE and "/clock" in finding.message
        # The first time that is told is no step.
        assert clock.judge(1_700_000_000 * SECOND, 5.0).level is Level.OK

    def test_simulated_time_that_stands_still_is_told_and_goes_on(self):
        clock = Clockwork(True)
        finding = self.looked(clock, (100, 1), (100, 1.1 + Clockwork.STANDSTILL))
        assert finding.level is Level.WARN and "stands still" in finding.message
        assert self.looked(clock, (101, 10)).level is Level.OK

    def test_another_computer_whose_clock_is_off_is_named(self):
        clock = Clockwork(False)
        for beat in range(Clockwork.FEWEST_HEARTBEATS):
            now = round((100 + 0.5 * beat) * SECOND)
            assert clock.judge(now, 0.5 * beat).level is Level.OK
            # On its way for 10 ms, but one for long.
            way = round((0.01 if beat else 5.0) * SECOND)
            for name, late in (("/near", 0.08), ("/behind", 0.1), ("/ahead", -0.2)):
                clock.hear(name, "computer", now - way - round(late * SECOND), now)
            clock.hear("/simulated", "/clock", 5 * SECOND, now)
        finding = clock.judge(now, 0.5 * beat)
        assert finding.level is Level.WARN
        assert "/ahead, /behind" in finding.message and "/near" not in finding.message
        assert float(finding.values["/behind is behind by (s)"]) == pytest.approx(0.11, abs=1e-6)
        clock.forget(["/ahead", "/behind"])
        assert clock.judge(now, 0.5 * beat).level is Level.OK

    def test_simulated_time_comes_to_each_when_it_comes(self):
        clock = Clockwork(True)
        for _ in range(Clockwork.FEWEST_HEARTBEATS):
            clock.hear("/late", "/clock", 0, 100 * SECOND)
        assert clock.judge(100 * SECOND, 1.0).level is Level.OK
