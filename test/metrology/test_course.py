"""What becomes of an effect from run to run: classes, false alarms, power, bands."""

from collections import Counter

import numpy as np
import pytest

from stepdiag_ros.metrology.discrepancy.course import (
    CHANGE_LEVEL,
    CHANGES,
    COMES_AND_GOES,
    GROWS,
    IN_ALL,
    UNDETERMINED,
    SizesInRun,
    course_of,
)

NOTHING = SizesInRun(np.zeros((1, 1)), np.zeros(1), 100.0)


def shown(size, uncertainty=1.0, freedom=100.0):
    return SizesInRun(np.eye(1) / uncertainty**2, np.array([size]) / uncertainty**2, freedom)


def judged(sizes, renewed=False, level=CHANGE_LEVEL):
    runs = [NOTHING if size is None else shown(size) for size in sizes]
    return course_of(runs, np.arange(float(len(runs))), np.ones(1), level, renewed)


def drawn(rng, truth, freedom, count=1):
    """A run whose noise is estimated, with sizes that are correlated, each of uncertainty 1."""
    information = np.linalg.inv(0.5 * np.eye(count) + 0.5)
    score = information @ np.full(count, truth)
    score += np.linalg.cholesky(information) @ rng.standard_normal(count)
    variance = rng.chisquare(freedom) / freedom
    return SizesInRun(information / variance, score / variance, freedom)


@pytest.mark.parametrize(
    ("sizes", "kind", "having", "lacking", "blind"),
    [
        ((20, 20.5, 19, 20), IN_ALL, (0, 1, 2, 3), (), ()),
        ((20, None, 19, 20), IN_ALL, (0, 2, 3), (), (1,)),
        ((0, 10, 20, 30), GROWS, (1, 2, 3), (0,), ()),
        ((30, 20, 10, 0), GROWS, (0, 1, 2), (3,), ()),
        ((0, 0, 20, 0, 0), COMES_AND_GOES, (2,), (0, 1, 3, 4), ()),
        ((20, 20, 0, 20, None), COMES_AND_GOES, (0, 1, 3), (2,), (4,)),
        ((0, 20, 0, 30, 0), COMES_AND_GOES, (1, 3), (0, 2, 4), ()),
        ((20, 30, 15, 40), CHANGES, (0, 1, 2, 3), (), ()),
        ((0, 2, 20, 80), CHANGES, (2, 3), (0, 1), ()),
        ((0, 20), CHANGES, (1,), (0,), ()),
        ((20, None, None), UNDETERMINED, (0,), (), (1, 2)),
    ],
)
def test_what_is_said_of_clear_sizes(sizes, kind, having, lacking, blind):
    course = judged(sizes)
    assert (course.kind, course.having) == (kind, having)
    assert (course.lacking, course.blind) == (lacking, blind)


def test_the_figures_of_each_kind_are_those_of_least_squares():
    steady = judged((20.0, 21.0, 19.0, 20.0))
    assert steady.common.value == pytest.approx(20.0)
    assert steady.common.standard_uncertainty == pytest.approx(0.5)
    assert steady.explained == pytest.approx((20.0,) * 4)
    growing = judged((1.0, 10.0, 20.0, 31.0))
    assert growing.rate.value == pytest.approx(np.polyfit(np.arange(4), (1, 10, 20, 31), 1)[0])
    assert growing.rate.standard_uncertainty == pytest.approx(1.0 / np.sqrt(5.0))
    assert np.isnan(growing.common.value)
    some = judged((0.5, 21.0, -0.5, 19.0, 0.0))
    assert some.common.value == pytest.approx(20.0)
    assert some.explained == pytest.approx((0.0, 20.0, 0.0, 20.0, 0.0))


def test_an_effect_of_an_alignment_does_not_grow():
    assert judged((0.0, 10.0, 20.0)).kind == GROWS
    course = judged((0.0, 10.0, 20.0), renewed=True)
    assert (course.kind, course.having, course.lacking) == (COMES_AND_GOES, (1, 2), (0,))
    assert np.isnan(course.rate.value)


def test_two_runs_do_not_show_a_growth():
    course = judged((5.0, 25.0))
    assert course.kind == CHANGES
    assert np.isnan(course.rate.value) and np.isnan(course.p_line)


def test_units_of_the_sizes_change_nothing():
    rng = np.random.default_rng(3)
    runs = [drawn(rng, truth, 50, count=2) for truth in (0.0, 9.0, 18.0)]
    units = np.diag([1e6, 1e-3])
    others = [
        SizesInRun(units @ one.information @ units, units @ one.score, one.freedom) for one in runs
    ]
    months = np.array([0.0, 2.0, 5.0])
    one = course_of(runs, months, np.ones(2))
    other = course_of(others, months, np.linalg.inv(units) @ np.ones(2) * 0 + np.diag(units))
    assert (one.kind, one.having) == (other.kind, other.having)
    assert other.rate.value == pytest.approx(one.rate.value, rel=1e-6)
    assert other.p_common == pytest.approx(one.p_common, rel=1e-6)


def test_a_size_that_a_run_does_not_determine_is_unknown():
    line = np.array([[1.0, 1.0], [1.0, 1.0]])
    runs = [SizesInRun(line, line @ np.array([4.0, 5.0]), 100.0)] * 2
    both = course_of(runs, np.arange(2.0), np.ones(2))
    assert both.sizes[0].value == pytest.approx(9.0)
    alone = course_of(runs, np.arange(2.0), np.array([1.0, 0.0]))
    assert np.isnan(alone.sizes[0].value) and np.isnan(alone.common.value)


@pytest.mark.parametrize(
    ("runs", "count", "freedom"), [(2, 1, 8), (4, 1, 30), (4, 2, 8), (6, 1, 100)]
)
def test_machines_without_change_are_seldom_said_to_change(runs, count, freedom):
    """At most 4 %: of 250 no more than 18 (probability of more: 0.6 %)."""
    rng = np.random.default_rng(runs + 10 * count)
    said = Counter(
        course_of(
            [drawn(rng, 10.0, freedom, count) for _ in range(runs)],
            np.arange(float(runs)),
            np.ones(count),
        ).kind
        for _ in range(250)
    )
    assert said[GROWS] + said[COMES_AND_GOES] + said[CHANGES] <= 18, said
    assert said[IN_ALL] >= 225, said


@pytest.mark.parametrize(
    ("truth", "kind"), [((0, 3, 6, 9, 12), GROWS), ((0, 12, 0, 0, 12), COMES_AND_GOES)]
)
def test_a_change_of_twelve_standard_uncertainties_is_found_and_rightly_called(truth, kind):
    rng = np.random.default_rng(9)
    said = Counter(
        course_of([drawn(rng, one, 100) for one in truth], np.arange(5.0), np.ones(1)).kind
        for _ in range(150)
    )
    assert said[kind] >= 140, said
    assert said[IN_ALL] == 0


def test_nineteen_of_twenty_bands_contain_the_true_value():
    rng = np.random.default_rng(4)
    rates, sizes = 0, 0
    for _ in range(200):
        growing = course_of(
            [drawn(rng, 10.0 * month, 12) for month in range(4)], np.arange(4.0), np.ones(1)
        )
        steady = course_of([drawn(rng, 9.0, 12) for _ in range(4)], np.arange(4.0), np.ones(1))
        rates += growing.rate.band[0] < 10.0 < growing.rate.band[1]
        low, high = steady.common.band
        sizes += steady.kind != IN_ALL or low < 9.0 < high
    assert 182 <= rates <= 199
    assert 182 <= sizes <= 199
