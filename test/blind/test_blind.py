"""A small run of the blind test; the whole is benchmarks/blind.py, its results docs/blind.md."""

import pytest
from blind_figures import as_table, confusion, figures, missed
from blind_harness import blind_test

LARGEST = 700
"""Readings of a run: few, so that all cases take seconds."""
CASES = [
    *(("none", seed, None) for seed in range(3)),
    *(("one", seed, level) for seed, level in enumerate((2.0, 2.0, 5.0, 5.0))),
    *(("two", seed, None) for seed in range(1)),
    *(("outside", seed, None) for seed in range(2)),
    *(("pair", seed, 5.0) for seed in range(1)),
]
NULLS = len(CASES)


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    return blind_test(tmp_path_factory.mktemp("blind"), CASES, processes=1, largest=LARGEST)


def test_every_case_and_its_null_run_has_a_verdict(judged):
    assert len([one for one in judged if one["truth"]["class"] == "none"]) == NULLS
    assert len(judged) == 2 * NULLS - 3


def test_no_figure_of_the_issue_is_missed_beyond_chance(judged):
    counted = figures(judged)
    assert missed(counted) == [], as_table(confusion(judged), "hidden")


def test_no_more_is_wrong_than_so_few_runs_allow(judged):
    """At the issue's rates two false names of 11, or two lost effects of 6, are 1 in 30 or less."""
    table = as_table(confusion(judged), "hidden")
    counted = figures(judged)
    assert counted["false_name_on_null"]["hits"] <= 1, table
    hidden = [one for one in judged if one["truth"]["class"] in ("one", "two", "pair")]
    lost = [one["name"] for one in hidden if not one["outcome"].startswith("right")]
    assert len(lost) <= 1, f"{lost}\n{table}"
    assert counted["outside_unexplained_or_group"]["hits"] >= 1, table


def test_sizes_are_told_in_the_workflow_s_own_limits(judged):
    scaled = [one["truth"] for one in judged if one["truth"]["class"] == "one"]
    assert all(truth["scaled_by"] == "workflow" for truth in scaled)
    ratios = [ratio for truth in scaled for ratio in truth["limit_over_yardstick"]]
    # Both say what stands out of the noise of this plan; they differ by the look-elsewhere effect.
    assert all(0.5 < ratio < 2.0 for ratio in ratios)
