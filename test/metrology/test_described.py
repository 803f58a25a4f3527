"""Names against a formula: when they say the same, and when the formula rivals the names."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_runs import hidden_run

from stepdiag_ros.metrology.discrepancy import AMBIGUOUS, NAMED, diagnose
from stepdiag_ros.metrology.discrepancy.describe import Shapes
from stepdiag_ros.metrology.discrepancy.described import (
    WITHOUT_A_NAME,
    or_without_a_name,
    says_the_same,
)
from stepdiag_ros.metrology.discrepancy.findings import Dependence, Diagnosis
from stepdiag_ros.metrology.effects.backlash import EFFECT as BACKLASH
from stepdiag_ros.metrology.effects.effect import ActiveEffect


@pytest.fixture(scope="module")
def named() -> Diagnosis:
    """Return a diagnosis that names backlash of two axes."""
    worn = [ActiveEffect(BACKLASH, {"axis": axis}, {"lost_motion": 1e-6}) for axis in "XZ"]
    found = diagnose(hidden_run(*worn), catalogue=[BACKLASH])
    assert found.verdict == NAMED and len(found.findings) == 2
    return found


def off(named, chi_squared):
    """Return the diagnosis with readings that are so far from what it leaves of them."""
    apart = named.noise * np.sqrt(chi_squared / len(named.residual_after))
    return replace(named, residual_after=named.residual_after + apart)


def test_names_and_a_formula_that_leave_the_same_readings_say_the_same(named):
    assert says_the_same(named, off(named, 8.0))
    assert not says_the_same(named, off(named, 10.0))


def test_what_differs_by_a_fifth_of_what_it_explains_does_not_say_the_same(named):
    weak = replace(named, residual_before=off(named, 30.0).residual_after)
    assert says_the_same(weak, off(named, 5.0))
    assert not says_the_same(weak, off(named, 7.0))


def test_fewer_terms_than_the_sizes_of_the_names_do_not_say_the_same(named):
    assert not says_the_same(named, replace(named, findings=named.findings[:1]))


def test_a_formula_of_the_whole_gap_rivals_each_name(named):
    one = Dependence("X", ("time",), ("t^1",), 50.0, 1e-9, 1.0, ())
    found = or_without_a_name(named, Shapes((one,), 20.0), ahead=0.0)
    assert found.verdict == AMBIGUOUS
    for finding in found.findings:
        (rival,) = [one for one in finding.runners_up if one.ambiguous]
        assert rival.label.startswith(WITHOUT_A_NAME) and rival.probability == pytest.approx(0.5)
