"""Candidates judged from products of columns: the same as least squares column by column."""

import numpy as np
import pytest
from hidden_runs import NOISE, hidden_run
from scipy import sparse

from stepdiag_ros.metrology.discrepancy.baseline import fit_baseline, whitened
from stepdiag_ros.metrology.discrepancy.candidates import signatures
from stepdiag_ros.metrology.discrepancy.chance import LookElsewhere, tail
from stepdiag_ros.metrology.discrepancy.ranking import Ranker
from stepdiag_ros.metrology.discrepancy.sizes import Sizes
from stepdiag_ros.metrology.effects.abbe_offset import EFFECT as ABBE
from stepdiag_ros.metrology.effects.angular_error import EFFECT as ANGULAR
from stepdiag_ros.metrology.effects.backlash import EFFECT as BACKLASH
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.smooth_angular_error import EFFECT as WAVY
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.effects.warm_up_drift import EFFECT as WARM_UP

CATALOGUE = (BACKLASH, ANGULAR, WAVY, ABBE)
FREEDOM = 334.0


@pytest.fixture(scope="module")
def ranker():
    backlash = ActiveEffect(BACKLASH, {"axis": "X"}, {"lost_motion": 0.6e-6})
    angle = ActiveEffect(ANGULAR, {"error": "E_CZ"}, {"linear": 60e-6, "quadratic": -30e-6})
    run = hidden_run(backlash, angle)
    stops = stops_of(run)
    problem = whitened(fit_baseline(run, stops), NOISE, 0.1)
    found = signatures(CATALOGUE, stops, problem)
    return Ranker(found, problem.gap, LookElsewhere(500.0, FREEDOM))


def index_of(ranker, label):
    return [candidate.label for candidate in ranker.found.candidates].index(label)


def squares_left(columns, gap):
    lengths = np.linalg.norm(columns, axis=0)
    columns = columns[:, lengths > 0.0] / lengths[lengths > 0.0]
    return float(np.sum((gap - columns @ np.linalg.lstsq(columns, gap, rcond=1e-6)[0]) ** 2))


@pytest.mark.parametrize("given", [(), ("backlash of X",), ("backlash of X", "backlash of Y")])
def test_gains_are_those_of_least_squares(ranker, given):
    found = ranker.found
    beside = [index_of(ranker, label) for label in given]
    ranking = ranker.ranking(beside)
    named = [
        *(found.columns.dense(found.of(index)) for index in beside),
        *ranker.unknown(beside),
        np.zeros((len(ranker.gap), 1)),
    ]
    before = squares_left(np.column_stack(named), ranker.gap)
    checked = 0
    for index in range(len(found.candidates)):
        if index in beside or not np.isfinite(ranking.gain[index]):
            continue
        first = int(found.first[index])
        gains = [
            before
            - squares_left(
                np.column_stack([*named, found.columns.dense(slice(first, first + m))]), ranker.gap
            )
            for m in range(1, int(found.count[index]) + 1)
        ]
        assert np.min(np.abs(np.array(gains) - ranking.gain[index])) < 1e-6 * before
        chances = tail(np.array(gains), np.arange(1, len(gains) + 1, dtype=float), FREEDOM)
        assert ranking.chance[index] == pytest.approx(np.min(chances), rel=1e-4)
        checked += 1
    assert checked > 30


def test_evidence_weighs_the_gain_against_sizes_and_rivals(ranker):
    ranking = ranker.ranking([])
    found = ranker.found
    index = index_of(ranker, "backlash of X")
    expected = 0.5 * ranking.gain[index] - 0.5 * np.log(len(ranker.gap)) + np.log(1.0 / 3.0)
    assert ranking.evidence[index] == pytest.approx(expected, rel=1e-9)
    # Two more sizes that gain next to nothing are a loss, and a wavy error has five.
    simple, wavy = (
        index_of(ranker, "angular error E_AX"),
        index_of(ranker, "wavy angular error E_AX"),
    )
    if ranking.gain[wavy] < ranking.gain[simple] + 2.0:
        assert ranking.evidence[wavy] < ranking.evidence[simple]
    assert found.count[wavy] == 5


def test_a_size_beyond_what_is_plausible_costs(ranker):
    from dataclasses import replace

    found = ranker.found
    # The same columns in a hundredth of the unit need a hundred times the size.
    smaller = sparse.csc_array(sparse.diags_array(np.full(found.columns.count, 1e-4)))
    small = replace(found, columns=found.columns.turned(smaller), lengths=found.lengths / 1e4)
    ranking = Ranker(small, ranker.gap, ranker.luck).ranking([])
    index = index_of(ranker, "backlash of X")
    plain = ranker.ranking([])
    assert plain.cost[index] == 0.0
    assert ranking.cost[index] == pytest.approx(3.0 * np.log(20.0))
    assert plain.evidence[index] - ranking.evidence[index] == pytest.approx(3.0 * np.log(20.0))


def test_given_candidates_are_out_of_the_question(ranker):
    index = index_of(ranker, "backlash of X")
    assert ranker.ranking([index]).evidence[index] == -np.inf
    assert np.isfinite(ranker.ranking([]).evidence[index])


def test_sizes_are_fitted_together_with_their_joint_covariance(ranker):
    found = ranker.found
    one, two = index_of(ranker, "backlash of X"), index_of(ranker, "angular error E_CZ")
    sizes = Sizes(ranker, [one, two])
    matrix = np.column_stack(
        [found.columns.dense(found.of(one)), found.columns.dense(found.of(two))]
    )
    unknown = np.column_stack([*ranker.unknown([one, two]), np.zeros((len(ranker.gap), 0))])
    scale = np.linalg.norm(matrix, axis=0)
    both = np.column_stack([matrix / scale, unknown])
    inverse = np.linalg.pinv(both.T @ both, rcond=1e-10)
    values = (inverse @ (both.T @ ranker.gap))[:3] / scale
    assert sizes.values[one][0] == pytest.approx(values[0], rel=1e-6)
    assert sizes.values[two] == pytest.approx(values[1:], rel=1e-6)
    covariance = inverse[:3, :3] / np.outer(scale, scale)
    assert sizes.covariance == pytest.approx(covariance, rel=1e-5)
    assert sizes.of(two) == pytest.approx(covariance[1:, 1:], rel=1e-5)
    turned = sizes.in_order([two, one])
    assert turned == pytest.approx(covariance[np.ix_([1, 2, 0], [1, 2, 0])], rel=1e-5)
    # The parts of the turn are told badly, their sum well.
    whole = np.sqrt(np.sum(sizes.of(two)))
    assert whole < 0.4 * np.sqrt(sizes.of(two)[0, 0])


def test_a_time_constant_that_is_not_sure_makes_the_size_less_sure():
    run = hidden_run(shape=lambda stops: -0.15e-6 * np.exp(-stops.time / 900.0))
    stops = stops_of(run)
    problem = whitened(fit_baseline(run, stops), NOISE, 0.0)
    found = signatures((WARM_UP,), stops, problem)
    ranker = Ranker(found, problem.gap, LookElsewhere(50.0, FREEDOM))
    best = int(np.argmax(ranker.ranking([]).evidence))
    columns = found.columns.dense(found.of(best))
    alone = 1.0 / float(columns[:, 0] @ columns[:, 0])
    assert Sizes(ranker, [best]).of(best)[0, 0] > 1.05 * alone
