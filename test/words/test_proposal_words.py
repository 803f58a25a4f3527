"""What to measure next: the plan with its file, what it depends on, and what stays open."""

from dataclasses import replace

from stepdiag_ros.metrology.discrepancy.proposal import ExtraPlan, LeftOpen
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.words.proposal import proposal_sentences

OPEN = LeftOpen(("backlash of X", "sag"), "Measure with another instrument.")
NOTHING = ExtraPlan((), None, float("nan"), float("nan"), (), ())


def planned(**changed):
    plan = Plan.from_mapping(
        {
            "step_m": [0.01, 0.01, 0.01],
            "blocks": 3,
            "feed_m_per_s": 0.05,
            "lines": [{"kind": "linear", "names": ["x"]}],
        },
        "a plan",
    )
    made = ExtraPlan((("backlash of X", "sag"),), plan, 600.0, 0.97, (), (OPEN,))
    return replace(made, **changed)


def test_nothing_is_said_where_no_plan_was_asked_for():
    assert proposal_sentences(None) == []


def test_a_plan_comes_with_its_file_its_conditions_and_what_stays_open():
    said = proposal_sentences(planned(conditions=("On another day.",)), "more.yaml")
    assert said[0] == planned().sentence
    assert "more.yaml" in said[1]
    assert said[2:] == ["On another day.", OPEN.why]


def test_where_no_plan_helps_what_would_is_said_once():
    said = proposal_sentences(replace(NOTHING, rivals=(OPEN.labels,), left_open=(OPEN,)))
    assert len(said) == 1 and said[0].count(OPEN.why) == 1
