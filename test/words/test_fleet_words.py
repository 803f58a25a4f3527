"""What is stated of a fleet in words: numbers of machines, and dates of leaving."""

from dataclasses import replace
from datetime import datetime, timezone
from math import nan

import pytest

from stepdiag_ros.archive.fleet import FleetMachine, FleetRun, Judged
from stepdiag_ros.archive.histories import FigureHistory, MachineHistory
from stepdiag_ros.metrology.standards.conformity import Conformity
from stepdiag_ros.metrology.trends.crossing import Crossing, Outlook
from stepdiag_ros.metrology.trends.trend import Trend
from stepdiag_ros.words.fleet import (
    beside_words,
    headline,
    outlook_words,
    sentences,
    verdict_words,
)

DAY = datetime(2026, 1, 1, tzinfo=timezone.utc)
RUN = FleetRun("r", DAY, "CONSISTENT", False, 1e-6, 1e-7, nan, "", "0" * 64, "", "", True, False)


def machine(history=None, **states):
    judged = [
        Judged(name.replace("_", " "), "m", 1e-6, 1e-7, 1e-6, state)
        for name, state in states.items()
    ]
    return FleetMachine("mill", "", (RUN,), tuple(judged), history)


def history(*crossings):
    """Return the years of a machine whose figures cross so, from March 2026 on."""
    figures = [
        FigureHistory("result", f"f{number}", "m", (DAY,), [1e-6], [1e-7], trend, 1e-5, 0)
        for number, trend in enumerate(Trend(9, 56.2, crossing=one) for one in crossings)
    ]
    return MachineHistory("mill", 9, DAY, DAY, (), tuple(figures), 0, True)


@pytest.mark.parametrize(
    ("states", "number"),
    [
        ([Conformity.NOT_WITHIN, Conformity.WITHIN], "1 of 2"),
        ([Conformity.UNDECIDED, Conformity.WITHIN], "none"),
        ([Conformity.NOT_WITHIN] * 3, "3 of 3"),
        ([Conformity.NOT_ASKED], "1 machine,"),
    ],
)
def test_the_headline_counts_what_is_proven(states, number):
    assert number in headline([machine(C0Y=one) for one in states])


def test_a_run_of_a_simulated_cell_is_marked_beside_its_verdict():
    simulated = replace(RUN, simulated=True)
    assert "simulated" in verdict_words(simulated) and RUN.verdict in verdict_words(simulated)
    assert "simulated" not in verdict_words(RUN)


def test_nothing_is_overdue_where_no_interval_is_stated():
    fleet = [machine(C0Y=Conformity.WITHIN)]
    assert any("unknown" in one for one in sentences(fleet, None, DAY.replace(year=2030)))
    assert any("1 overdue" in one for one in sentences(fleet, 30, DAY.replace(year=2030)))
    assert any("0 overdue" in one for one in sentences(fleet, 30, DAY))


@pytest.mark.parametrize(
    ("crossings", "words"),
    [
        ([Crossing(Outlook.NO_TREND, 4.0), Crossing(Outlook.TOO_FAR, 2.5)], "not by 2028-09"),
        # Until when nothing is outside is as little known as of the least known figure.
        ([Crossing(Outlook.NO_TREND, 4.0), Crossing(Outlook.WANDERS)], "unknown"),
        ([Crossing(Outlook.NO_TREND, 4.0), Crossing(Outlook.NOT_ASKED)], "not by 2030-03"),
        ([Crossing(Outlook.NOT_ASKED)], "no tolerance"),
        ([Crossing(Outlook.INTERVAL, 1.0, 2.0)], "2027-03..2028-03 outside: f0"),
        ([Crossing(Outlook.INTERVAL, 1.0, 2.0), Crossing(Outlook.OUTSIDE)], "outside: f1"),
    ],
)
def test_when_a_machine_leaves_its_tolerance(crossings, words):
    assert outlook_words(machine(history(*crossings))) == words


def test_a_machine_without_history_has_an_unknown_outlook():
    assert outlook_words(machine()) == "unknown"


def test_the_figure_that_decides_is_named_unless_it_is_the_largest_error():
    beyond, within = Conformity.NOT_WITHIN, Conformity.WITHIN
    assert beside_words(machine(largest_in_volume=within, C0Y=beyond, B0Z=beyond)) == "C0Y +1"
    assert beside_words(machine(largest_in_volume=beyond, C0Y=beyond)) == ""
    assert beside_words(machine(C0Y=within)) == ""
