"""A formula that another one rivals: further lines show which of the two acts."""

import numpy as np
import pytest
from hidden_runs import hidden_run

from stepdiag_ros.metrology.discrepancy import DESCRIBED, diagnose
from stepdiag_ros.metrology.discrepancy.joint import joined
from stepdiag_ros.metrology.discrepancy.proposal import is_open
from stepdiag_ros.metrology.effects.angular_error import EFFECT as ANGULAR
from stepdiag_ros.metrology.effects.sag import EFFECT as SAG
from stepdiag_ros.planning.separation import propose_extra

CATALOGUE = (ANGULAR, SAG)
SIZE = 3e-6


def bend(component):
    """Return a bend along one axis where X and Y are both beyond the middle."""

    def shape(stops):
        beyond = 2.0 * np.maximum(stops.share - 0.5, 0.0)
        return stops.direction[:, component] * SIZE * beyond[:, 0] * beyond[:, 1]

    return shape


@pytest.mark.parametrize("component", [0, 1], ids=["X", "Y"])
def test_one_more_line_shows_along_which_axis_a_bend_displaces_the_tool(component):
    run = hidden_run(shape=bend(component))
    found = diagnose(run, catalogue=CATALOGUE)
    assert found.verdict == DESCRIBED and is_open(found)
    (open_one,) = found.description.dependences
    assert {open_one.acts_on, *(acts_on for acts_on, _ in open_one.rivals)} == {"X", "Y"}
    proposal = propose_extra(run, found, catalogue=CATALOGUE)
    assert proposal.certainty > 0.9 and len(proposal.plan.lines) <= 4
    assert [len(group) for group in proposal.rivals] == [2]
    more = hidden_run(shape=bend(component), plan=proposal.plan, seed=6, machine=5)
    both = diagnose(joined([run, more]), catalogue=CATALOGUE)
    assert both.verdict == DESCRIBED and not is_open(both)
    (settled,) = both.description.dependences
    assert (settled.acts_on, settled.drivers) == (
        "XY"[component],
        ("the place of X", "the place of Y"),
    )


def test_what_depends_on_the_time_of_a_run_does_not_come_again():
    def swing(stops):
        wave = np.sin(2.0 * np.pi * stops.time / (stops.duration / 6.0))
        return stops.direction[:, 0] * SIZE * wave

    run = hidden_run(shape=swing, linear=())
    found = diagnose(run, catalogue=CATALOGUE)
    assert found.verdict == DESCRIBED
    assert propose_extra(run, found, catalogue=CATALOGUE).plan is None
