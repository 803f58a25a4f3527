"""Numbered events: a repetition is known, a contradiction refused, the memory bounded."""

import math

import pytest
from refused import refused

from stepdiag_ros.metrology import rising
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.rising import Rising


def test_an_event_is_new_once():
    stream = Rising("command")
    taken = [stream.is_new(*event) for event in [(1, "a"), (4, "b"), (1, "a"), (4, "b"), (5, "b")]]
    assert taken == [True, True, False, False, True]


def test_what_is_no_number_does_not_contradict_itself():
    stream = Rising("arrival")
    assert stream.is_new(1, (math.nan, 0.0))
    assert not stream.is_new(1, (math.nan, 0.0))
    with pytest.raises(ValueError):
        stream.is_new(1, (math.nan, -0.0))


@pytest.mark.parametrize(("number", "event"), [(4, "c"), (2, "a"), (-1, "a")])
def test_a_contradiction_is_refused_and_the_stream_goes_on(number, event):
    stream = Rising("command")
    stream.is_new(1, "a")
    stream.is_new(4, "b")
    with refused(Refusal, "out_of_order", "command", str(number)):
        stream.is_new(number, event)
    assert stream.is_new(5, "e")


def test_more_events_than_any_run_has_are_refused(monkeypatch):
    monkeypatch.setattr(rising, "MOST", 3)
    stream = Rising("arrival")
    assert all(stream.is_new(number, "x") for number in range(3))
    with refused(Refusal, "too_many", "3"):
        stream.is_new(3, "x")
    assert not stream.is_new(2, "x")
