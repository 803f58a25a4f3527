"""What a run is to reach: how it is written, and after which lines enough is measured to tell."""

import pytest
from refused import refused

from stepdiag_ros.configuration import plan_from_text, target_from_text
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.target import Target, lacking_runs, line_ends

PLAN = """\
name: two axes
step_m: [0.03, 0.02, 0.025]
blocks: 2
repeats: {repeats}
directions: [forward, backward]
feed_m_per_s: 0.05
lines:
  - {{kind: linear, names: [x, y]}}
"""
CONDITIONS = "until: X:A=1um\nconditions: {environmental_variation_m: 2.0e-7}\n"


def plan_of(repeats):
    return plan_from_text(PLAN.format(repeats=repeats), "plan")


@pytest.mark.parametrize(
    ("text", "quantity", "size", "unit"),
    [
        ("0.5um", "volumetric", 0.5e-6, "m"),
        ("volumetric = 500 nm", "volumetric", 0.5e-6, "m"),
        ("E_XX=3e-4mm", "E_XX", 0.3e-6, "m"),
        ("C0Y=2urad", "C0Y", 2e-6, "rad"),
        ("B0Z=2 µm/m", "B0Z", 2e-6, "rad"),
        ("E_AX=1µrad", "E_AX", 1e-6, "rad"),
        ("X:mean B=1um", "X:mean B", 1e-6, "m"),
        ("ppp:E↑=1um", "ppp:E↑", 1e-6, "m"),
    ],
)
def test_a_target_is_a_quantity_a_size_and_a_unit(text, quantity, size, unit):
    target = target_from_text(text)
    assert (target.quantity, target.unit) == (quantity, unit)
    assert target.size == pytest.approx(size)


@pytest.mark.parametrize(
    ("text", "fault", "names"),
    [
        ("0.5", "malformed", ("0.5",)),
        ("0.5 inch", "malformed", ("inch",)),
        ("half", "malformed", ("half",)),
        ("1e--6um", "out_of_range", ()),
        ("0um", "out_of_range", ()),
        ("nanum", "malformed", ()),
        ("2m", "out_of_range", ()),
        ("E_XX=1urad", "mismatch", ("E_XX", "urad")),
        ("C0Y=1um", "mismatch", ("C0Y", "um")),
        ("E_QQ=1um", "unknown", ("E_QQ", "E_XX")),
        ("X:Q=1um", "unknown", ("Q", "mean B")),
        ("until: 1um\nbeside: 2", "unknown", ("beside",)),
        ("conditions: {}\nother: 1", "missing", ("until",)),
    ],
)
def test_what_is_not_a_target_is_refused(text, fault, names):
    with refused(Refusal, fault, *names):
        target_from_text(text)


def test_the_conditions_of_a_test_come_with_its_target():
    target = target_from_text(CONDITIONS)
    assert target.conditions.environmental_variation == 2e-7
    assert target.line_and_parameter == ("X", "A")


def test_a_line_that_was_begun_needs_its_least_runs_in_both_directions():
    target = Target("E_XX", 1e-6, "m")
    # x forward and backward twice, then y.
    assert line_ends(target, plan_of(2)) == (4, 8)
    assert line_ends(target, plan_of(3)) == (4, 5, 6, 10, 11, 12)
    assert line_ends(target, plan_of(1)) == (2, 4)
    (lacking,) = lacking_runs(target, plan_of(2), {0, 1, 2})
    assert (lacking[0].direction, *lacking[1:]) == ("backward", 1, 2)
    # A pass that has no value at a stop is not a run.
    (lacking,) = lacking_runs(target, plan_of(2), {0, 1, 3})
    assert (lacking[0].direction, *lacking[1:]) == ("forward", 1, 2)


def test_a_test_of_the_standard_needs_five_runs_in_both_directions_whatever_the_plan_has():
    target = Target("X:A", 1e-6, "m")
    assert line_ends(target, plan_of(2)) == ()
    assert min(line_ends(target, plan_of(6))) == 10
    assert min(line_ends(Target("Y:A", 1e-6, "m"), plan_of(6))) == 12 + 10
