"""A small run of the blind test; the whole is benchmarks/blind.py, its results docs/blind.md."""

import pytest
from blind_cases import draw_case, write_case
from blind_figures import as_table, confusion, figures, missed
from blind_harness import SCALED
from blind_schedule import blind_test

from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.table import import_table
from stepdiag_ros.metrology.discrepancy import CONSISTENT, diagnose

LARGEST = 700
"""Readings of a run: few, so that all cases take seconds."""
CASES = [
    ("none", 0, None, 0),
    ("none", 1, None, 0),
    *(("one", seed, level, 0) for seed, level in enumerate((2.0, 5.0, 5.0))),
    ("two", 0, None, 0),
    ("outside", 0, None, 0),
    ("outside", 1, None, 0),
    ("pair", 0, 5.0, 0),
    ("unseen", 0, None, 0),
    ("gross", 0, None, 0),
    ("gross", 1, None, 0),
    ("gross", 2, None, 0),
]
OF_CLASS = {kind: sum(one[0] == kind for one in CASES) for kind in {one[0] for one in CASES}}
NULLS = OF_CLASS["none"] + sum(OF_CLASS[kind] for kind in SCALED)


def test_an_effect_a_null_run_and_a_gross_error_are_told_apart(tmp_path):
    few = [CASES[place] for place in (3, 10)]
    judged = blind_test(tmp_path, few, processes=1, largest=LARGEST, progress=lambda _: None)
    assert len(judged) == 3
    assert [one["name"] for one in judged if not one["outcome"].startswith("right")] == []


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    root = tmp_path_factory.mktemp("blind")
    return blind_test(root, CASES, processes=1, largest=LARGEST, progress=lambda _: None)


def test_every_case_and_its_null_run_has_a_verdict(judged):
    assert len([one for one in judged if one["truth"]["class"] == "none"]) == NULLS
    assert len(judged) == len(CASES) + NULLS - OF_CLASS["none"]
    without = [one for one in judged if one["verdict"]["verdict"] in ("CRASH", "NO ANSWER")]
    assert without == []


def test_no_figure_of_the_issue_is_missed_beyond_chance(judged):
    assert missed(figures(judged)) == [], as_table(confusion(judged), "hidden")


def test_no_more_is_wrong_than_so_few_runs_allow(judged):
    """At the issue's rates two false names of 7, or two lost effects of 5, are 1 in 40 or less."""
    table = as_table(confusion(judged), "hidden")
    counted = figures(judged)
    assert counted["false_name_on_null"]["hits"] <= 1, table
    hidden = [one for one in judged if one["truth"]["class"] in SCALED]
    lost = [one["name"] for one in hidden if not one["outcome"].startswith("right")]
    assert len(lost) <= 1, f"{lost}\n{table}"
    outside = [one for one in judged if one["truth"]["class"] == "outside"]
    assert any(one["outcome"] != "wrong name" for one in outside), table
    assert counted["unseen_named"]["hits"] == 0, table
    assert counted["gross_named_as_something_else"]["hits"] == 0, table


def test_a_run_that_cannot_tell_gets_a_plan_or_the_reason_why_none_helps(judged):
    grouped = [
        one
        for one in judged
        if one["truth"]["class"] in SCALED
        and any(finding["ambiguous"] for finding in one["verdict"]["findings"])
    ]
    assert grouped
    assert all(one["verdict"]["further"]["proposal"]["sentence"] for one in grouped)


def test_sizes_are_told_in_the_workflow_s_own_limits(judged):
    scaled = [one["truth"] for one in judged if one["truth"]["class"] == "one"]
    assert all(truth["scaled_by"] == "workflow" for truth in scaled)
    ratios = [ratio for truth in scaled for ratio in truth["limit_over_yardstick"]]
    # Both say what stands out of the noise of this plan; they differ by the look-elsewhere effect.
    assert all(0.5 < ratio < 2.0 for ratio in ratios)


@pytest.mark.parametrize("seed", [95, 159, 589])
def test_few_passes_that_scatter_by_chance_like_an_effect_name_none(seed, tmp_path):
    """Rare nulls: seven zeros lie like three drifts, six like a swing, noise like turning axes."""
    case = draw_case("none", seed, largest=900)
    assert case.wander > 0.0
    folder = write_case(tmp_path / "case", case, ())
    bag = tmp_path / "run.mcap"
    import_table(folder / "run.csv", folder / "case.yaml", bag)
    assert diagnose(load_run(bag).measurement).verdict == CONSISTENT
