"""Sizes of one effect on several axes against noise, also where the axes do the same."""

from types import SimpleNamespace

import numpy as np
import pytest

from stepdiag_ros.metrology.discrepancy import siblings


def chance_of(values, covariance):
    sizes = SimpleNamespace(
        values={number: np.array([value]) for number, value in enumerate(values)},
        in_order=lambda _: np.array(covariance),
    )
    return siblings._chance(sizes, range(len(values)), 1e6)


def test_the_chance_of_sizes_is_that_of_their_squares():
    # The tail of chi squared with two degrees of freedom is exp(-x/2).
    chance = chance_of([2e-6, 1e-6], np.diag([1e-12, 1e-12]))
    assert chance == pytest.approx(np.exp(-2.5), rel=1e-3)


def test_axes_on_which_an_effect_does_the_same_count_once():
    twice = chance_of([1e-6, 1e-6], np.full((2, 2), 1e-12))
    assert twice == pytest.approx(chance_of([1e-6], [[1e-12]]), rel=1e-6)


def test_sizes_that_are_not_determined_may_be_noise():
    assert chance_of([1e-6], [[np.nan]]) == 1.0
