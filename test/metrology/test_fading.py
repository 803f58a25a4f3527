"""Backlash, or a creep that fades about as slowly as the axis turns round again."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_plan
from hidden_runs import BOTH, hidden_run

from stepdiag_ros.metrology.discrepancy import AMBIGUOUS, DESCRIBED, NAMED, diagnose
from stepdiag_ros.metrology.discrepancy.joint import joined
from stepdiag_ros.metrology.effects.angular_error import EFFECT as ANGULAR
from stepdiag_ros.metrology.effects.backlash import EFFECT as BACKLASH
from stepdiag_ros.metrology.effects.domain import since_reversal
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.learned_shape import fading_time
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.planning.separation import propose_extra

CATALOGUE = (ANGULAR, BACKLASH)
SIZE, CONSTANT = 1e-6, 20.0
"""m, s; X turns round after 23 s at most, when the creep has faded to a third."""
RUN = make_plan(blocks=7, repeats=2, directions=BOTH, orders=("XYZ", "YZX"))


def creep(stops):
    short = -0.5 * SIZE * stops.last_sense[:, 0] * np.exp(-since_reversal(stops, "x") / CONSTANT)
    return stops.direction[:, 0] * short


def lasting(stops):
    return ActiveEffect(BACKLASH, {"axis": "X"}, {"lost_motion": SIZE}).readings(stops)


@pytest.fixture(scope="module")
def first() -> tuple[Measurement, Plan]:
    """Return a run with a creep, and the extra plan for what it leaves open."""
    run = hidden_run(shape=creep)
    found = diagnose(run, catalogue=CATALOGUE)
    assert found.verdict == AMBIGUOUS
    (finding,) = found.findings
    rivals = [one for one in finding.ambiguous if "creep x" in one]
    assert finding.label == "backlash of X" and len(rivals) == 1
    proposal = propose_extra(run, found, RUN, catalogue=CATALOGUE)
    assert not proposal.left_open and proposal.certainty > 0.9
    return run, proposal.plan


def test_the_extra_plan_waits_until_the_creep_has_faded(first):
    _, plan = first
    assert plan.sampling.dwell * plan.volume.blocks > 2.0 * CONSTANT


@pytest.mark.parametrize(
    ("hidden", "verdict"), [(creep, DESCRIBED), (lasting, NAMED)], ids=["creep", "backlash"]
)
def test_slow_lines_show_which_it_is(first, hidden, verdict):
    _, plan = first
    fast = hidden_run(shape=hidden)
    slow = hidden_run(shape=hidden, plan=plan, seed=6, machine=5)
    found = diagnose(joined([fast, slow]), catalogue=CATALOGUE)
    assert found.verdict == verdict
    (finding,) = found.findings
    if verdict == DESCRIBED:
        assert fading_time(finding.candidate.setting["shape"]) == pytest.approx(CONSTANT, rel=0.5)
    else:
        low, high = finding.band["lost_motion"]
        assert finding.label == "backlash of X" and low < SIZE < high


def test_what_fades_within_few_stops_is_no_rival_of_clear_backlash():
    found = diagnose(hidden_run(shape=lasting), catalogue=CATALOGUE)
    assert found.verdict == NAMED and [one.label for one in found.findings] == ["backlash of X"]


def test_where_no_times_are_known_nothing_can_be_seen_to_fade():
    run = hidden_run(shape=creep)
    timeless = [replace(line, time=np.full_like(line.time, np.nan)) for line in run.lines]
    found = diagnose(replace(run, lines=tuple(timeless)), catalogue=CATALOGUE)
    assert not any("creep" in label for one in found.findings for label in one.ambiguous)
