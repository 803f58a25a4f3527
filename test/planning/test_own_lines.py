"""Axes along which no line of a plan runs, and what a line along them would give."""

from dataclasses import replace

import pytest

from stepdiag_ros.configuration import load_machine, load_plan
from stepdiag_ros.metrology.plan import LINEAR
from stepdiag_ros.planning.assessment import assess
from stepdiag_ros.planning.duration import duration
from stepdiag_ros.report.tables.plan import duration_table, summary_sentences

NOISE = 0.1e-6


def without(name):
    """Return the demo plan without the lines along an axis."""
    plan = load_plan("demo")[0]
    kept = tuple(line for line in plan.lines if (line.kind, line.name) != (LINEAR, name))
    return plan, replace(plan, lines=kept)


def test_an_axis_without_a_line_is_named_with_its_uncertainty_and_the_price_of_a_line():
    whole, plan = without("x")
    machine = load_machine("demo")[0]
    assessment = assess(plan, machine, NOISE)
    (one,) = assessment.without_line
    assert (one.axis, one.curve) == ("X", "E_XX")
    assert one.uncertainty == assessment.with_rotations.positioning["E_XX"]
    full = assess(whole, machine, NOISE)
    assert full.without_line == ()
    assert one.with_line == pytest.approx(full.with_rotations.positioning["E_XX"], rel=0.05)
    assert one.uncertainty > 3.0 * one.with_line
    assert one.volumetric_with_line == pytest.approx(full.with_rotations.volumetric, rel=0.05)
    taken = [line for line in duration(whole, machine).lines if line.setup == "x"]
    assert one.seconds == pytest.approx(sum(line.total for line in taken), rel=0.05)
    said = [text for text in summary_sentences(assessment, None) if "E_XX" in text]
    assert len(said) == 1 and f"{2e6 * one.uncertainty:.0f}"[0] in said[0]
    assert not any("E_XX" in text for text in summary_sentences(full, None))


def test_lines_from_the_first_corner_that_widen_the_box_are_explained():
    _, plan = without("x")
    assessment = assess(plan, load_machine("demo")[0], NOISE)
    (one,) = assessment.without_line
    now, texts = assessment.with_rotations.volumetric, []
    for then in (0.5 * now, 2.0 * now, float("nan")):
        changed = replace(assessment, without_line=(replace(one, volumetric_with_line=then),))
        texts.append([text for text in summary_sentences(changed, None) if "anywhere" in text])
    (better,), (worse,), unknown = texts
    assert unknown == [] and "rotations" in worse and "rotations" not in better


def test_a_line_at_another_edge_does_not_take_the_place_of_that_from_the_first_corner():
    whole, plan = without("x")
    machine = load_machine("demo")[0]
    away = [
        replace(line, offset=(0.0, 0.12, 0.12))
        for line in whole.lines
        if (line.kind, line.name) == (LINEAR, "x")
    ]
    shifted = replace(whole, lines=(*plan.lines, *away))
    (one,) = assess(shifted, machine, NOISE).without_line
    assert one.curve == "E_XX" and one.uncertainty > 2.0 * one.with_line


def test_a_plan_without_step_diagonals_says_nothing_of_axes_without_a_line():
    plan = load_plan("demo")[0]
    lines = tuple(line for line in plan.lines if line.kind == LINEAR and line.name != "x")
    assert assess(replace(plan, lines=lines), load_machine("demo")[0], NOISE).without_line == ()


def test_a_shifted_line_is_explained_beside_the_durations():
    plan, machine = load_plan("demo")[0], load_machine("demo")[0]
    line = next(line for line in plan.lines if line.name == "z")
    moved = replace(plan, lines=(*plan.lines, replace(line, offset=(0.0, 0.06, 0.0))))
    title = duration_table(duration(moved, machine)).title
    assert "z@0,0.06,0" in title and "0.06, 0 m" in title
    assert "@" not in duration_table(duration(plan, machine)).title


def test_only_repeats_show_repeatability():
    plan, machine = load_plan("demo")[0], load_machine("demo")[0]
    once = replace(plan, lines=tuple(line for line in plan.lines if line.repeat == 0))
    twice = replace(once, lines=(*once.lines, *(replace(one, repeat=1) for one in once.lines)))
    some = replace(once, lines=(*once.lines, replace(once.lines[0], repeat=1)))
    said = [
        [text for text in assess(one, machine, NOISE).limits if "repeatability" in text]
        for one in (once, some, twice)
    ]
    assert [len(one) for one in said] == [1, 1, 0] and said[0] != said[1]
    assert "--repeats" in said[0][0]
