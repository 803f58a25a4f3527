"""What is advised where a gap is unexplained: by what it looks like, for every look it may have."""

from dataclasses import replace

import numpy as np
import pytest
from standard_runs import PLAN, measured

from stepdiag_ros.metrology.discrepancy import patterns
from stepdiag_ros.metrology.discrepancy.findings import CONSISTENT, UNEXPLAINED, Pattern
from stepdiag_ros.metrology.discrepancy.patterns import JUMP
from stepdiag_ros.metrology.discrepancy.wrong_reading import WrongReading
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.words.next_measurement import _ADVICE, _SETTLING, next_sentences


class _Found:
    """As much of a diagnosis as is asked for."""

    def __init__(self, verdict, *looks, after=(), wrong_readings=()):
        self.verdict, self.patterns, self.patterns_after = verdict, looks, after
        self.wrong_readings = wrong_readings


def look(with_what, lines=("x",), place="the moves"):
    return Pattern(place, lines, with_what, 1e-6, 0.5, 100.0, 1e-9)


@pytest.fixture(scope="module")
def stops():
    _, measurement = measured(PLAN)
    lines = []
    for line in measurement.lines:
        air = line.environment.copy()
        air[:, 0] = 20.0 + 1e-3 * line.time
        air[:, 3] = 20.0 + 2e-3 * line.time
        lines.append(replace(line, environment=air))
    return stops_of(replace(measurement, lines=tuple(lines)))


def test_whatever_a_pattern_may_go_with_has_an_advice_of_its_own(stops):
    words = [what for what, _ in patterns._companions(stops)]
    words += [what for what, _ in patterns._swings(stops)][:1]
    words.append(JUMP)
    assert len(words) >= 10
    for what in words:
        fitting = [advice for key, advice in _ADVICE if key in what]
        assert len(fitting) == 1, what
        (said,) = next_sentences(_Found(UNEXPLAINED, look(what)))
        assert said == fitting[0].format(lines="x", them="it")
    used = {key for key, _ in _ADVICE if any(key in what for what in words)}
    assert used == {key for key, _ in _ADVICE}, "an advice that no pattern leads to"


def test_lines_are_named_and_advice_is_given_once():
    same = "the same in every pass"
    found = _Found(UNEXPLAINED, look(same, ("x", "ppp", "npp")), look("growing with time", ()))
    first, second = next_sentences(found)
    assert "measure x, ppp and npp once more" in first and "parallel to them" in first
    assert second.startswith("Measure all lines again")
    (said,) = next_sentences(_Found(UNEXPLAINED, look(same), look(same, ("x", "y"))))
    assert "measure x and y once more" in said
    (said,) = next_sentences(_Found(UNEXPLAINED, look(same), look(same, ())))
    assert "measure all lines once more" in said


def test_what_settles_is_to_be_waited_for(stops):
    places = [words for words, *_ in patterns._places(stops) if "right after" in words]
    assert places
    for place in places:
        found = _Found(UNEXPLAINED, look("growing with time", place=place))
        assert next_sentences(found)[-1] == _SETTLING


def test_without_a_pattern_there_is_still_something_to_do_and_otherwise_nothing_is_said():
    (said,) = next_sentences(_Found(UNEXPLAINED))
    assert "once more" in said
    assert next_sentences(_Found(UNEXPLAINED, after=(look(JUMP),)))[0].startswith("Measure that")
    assert next_sentences(_Found(CONSISTENT, look(JUMP))) == []


def test_temperatures_are_among_what_was_tried(stops):
    assert np.ptp(stops.air_temperature) > 0.0 and np.ptp(stops.material_temperature) > 0.0


def wrong_readings(*passes):
    """Return how a diagnosis names the fourth reading of some passes, by their places in a run."""
    _, run = measured(PLAN)
    return tuple(WrongReading(number, 3, 1e-6).words(run) for number in passes)


def test_of_a_wrong_reading_nothing_but_this_reading_is_to_be_looked_at():
    (which,), drift = wrong_readings(0), look("growing with time")
    for found in (
        _Found(UNEXPLAINED, drift, wrong_readings=(which,)),
        _Found(UNEXPLAINED, after=(drift,), wrong_readings=(which,)),
    ):
        (advice,) = next_sentences(found)
        assert which in advice and "opposite order" not in advice


def test_of_several_wrong_readings_each_is_to_be_looked_at():
    which = wrong_readings(0, -1)
    (advice,) = next_sentences(_Found(UNEXPLAINED, wrong_readings=which))
    # The operator finds them in the table by their places.
    assert all(one in advice and one.endswith(" mm)") for one in which)
    # In a table runs count from 1, in the name of a pass repeats from 0.
    assert "repeat 0" in advice.replace(which[0], "").replace(which[1], "")
