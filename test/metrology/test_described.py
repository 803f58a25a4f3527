"""Names against a formula: when they say the same, and when the formula rivals the names."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_runs import hidden_run

from stepdiag_ros.metrology.discrepancy import AMBIGUOUS, DESCRIBED, NAMED, described, diagnose
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


@pytest.mark.parametrize(("p_after", "verdict"), [(1e-3, AMBIGUOUS), (0.5, DESCRIBED)])
def test_a_likelier_formula_that_leaves_a_lack_of_fit_rivals_the_names(
    named, monkeypatch, p_after, verdict
):
    one = Dependence("X", ("time",), ("t^1",), 50.0, 1e-9, 1.0, ())
    formula = replace(off(named, 100.0), verdict=DESCRIBED, lack_of_fit_p_after=p_after)
    monkeypatch.setattr(described, "_is_too_large", lambda _: False)
    monkeypatch.setattr(described, "_worth_of_names", lambda *_: 10.0)
    monkeypatch.setattr(described, "Describer", lambda *_: lambda _: Shapes((one,), 30.0))
    monkeypatch.setattr(described, "_made", lambda *_: formula)
    problem, noise = SimpleNamespace(gap=np.zeros(3)), SimpleNamespace(freedom=50.0)
    found = described.described(named, 10.0, problem, None, noise, 0)
    assert found.verdict == verdict
    if verdict == AMBIGUOUS:
        rivals = [other for one in found.findings for other in one.runners_up if other.ambiguous]
        assert [one.probability for one in rivals] == pytest.approx([0.5, 0.5])
