"""How the blind test judges: outcomes, bounds, seals that stay shut, and the words it compares."""

import json

import pytest
from blind_figures import clopper_pearson, confusion, covered, figures, missed, outcome
from blind_harness import NoAnswerError, limited, opened
from blind_words import Entry, means


def verdict(word, *findings):
    made = [
        {
            "label": label,
            "ambiguous": list(others),
            "band": {"lost_motion": [0.5e-6, 1.5e-6]},
        }
        for label, *others in findings
    ]
    return {"verdict": word, "findings": made, "seconds": 1.0, "readings": 2000}


def truth(kind, *labels, level=2.0, expected=()):
    return {
        "class": kind,
        "labels": [list(one) for one in labels],
        "level": level,
        "expected": list(expected),
        "scaled_by": "workflow",
        "hidden": [{"kind": "backlash"} for _ in labels],
    }


ONE = truth("one", ("a", "a too"))
TWO = truth("two", ("a",), ("b",))
JUDGED = [
    (truth("none"), verdict("CONSISTENT"), "right"),
    (truth("none"), verdict("NAMED", ("a",)), "wrong name"),
    (truth("none"), verdict("AMBIGUOUS", ("a", "b")), "wrong name"),
    (truth("none"), verdict("UNEXPLAINED"), "unexplained"),
    (truth("none"), verdict("NOT TESTABLE"), "no verdict"),
    (ONE, verdict("NO ANSWER"), "no verdict"),
    (ONE, verdict("NAMED", ("a too",)), "right"),
    (ONE, verdict("NAMED", ("a", "b")), "right, in a group"),
    (ONE, verdict("AMBIGUOUS", ("b", "a")), "right, in a group"),
    (ONE, verdict("AMBIGUOUS", ("b", "c")), "wrong name"),
    (ONE, verdict("NAMED", ("a",), ("c",)), "wrong name"),
    (ONE, verdict("CONSISTENT"), "consistent"),
    (ONE, verdict("UNEXPLAINED"), "unexplained"),
    (TWO, verdict("NAMED", ("a",), ("b",)), "right"),
    (TWO, verdict("AMBIGUOUS", ("a",), ("c", "b")), "right, in a group"),
    (TWO, verdict("NAMED", ("a",)), "consistent"),
    (TWO, verdict("NAMED", ("a",), ("c",)), "wrong name"),
    (truth("outside", ()), verdict("UNEXPLAINED"), "right"),
    (truth("outside", ()), verdict("AMBIGUOUS", ("a", "b")), "right, in a group"),
    (truth("outside", ()), verdict("AMBIGUOUS", ("a", "b"), ("c",)), "wrong name"),
    (truth("outside", ()), verdict("NAMED", ("a",)), "wrong name"),
    (truth("outside", ()), verdict("CONSISTENT"), "consistent"),
]


@pytest.mark.parametrize(("hidden", "said", "expected"), JUDGED)
def test_a_verdict_is_judged(hidden, said, expected):
    assert outcome(hidden, said) == expected


def test_bounds_are_clopper_and_pearson_s():
    # Of 0 in n the upper bound solves (1 - p)^n = 2.5 %.
    low, high = clopper_pearson(0, 200)
    assert low == 0.0 and high == pytest.approx(1.0 - 0.025 ** (1.0 / 200.0))
    assert clopper_pearson(200, 200) == pytest.approx((0.025 ** (1.0 / 200.0), 1.0))
    # Newcombe 1998, Table I: 81 of 263.
    assert clopper_pearson(81, 263) == pytest.approx((0.2527, 0.3676), abs=5e-5)


def test_a_band_is_asked_only_for_the_effect_under_its_own_label():
    said = verdict("NAMED", ("a",))
    inside = truth("one", ("a",), expected=[{"a": {"lost_motion": 1e-6}}])
    outside = truth("one", ("a",), expected=[{"a": {"lost_motion": 1.6e-6}}])
    elsewhere = truth("one", ("a", "a too"), expected=[{"a too": {"lost_motion": 1e-6}}])
    assert covered(inside, said) == [True]
    assert covered(outside, said) == [False]
    assert covered(elsewhere, said) == []


def test_the_figures_count_what_they_say():
    judged = [
        {
            "truth": hidden,
            "verdict": said,
            "outcome": outcome(hidden, said),
            "held_out": 1.05 if said["verdict"] == "NAMED" else None,
        }
        for hidden, said, _ in JUDGED
    ]
    counted = figures(judged)
    assert counted["false_name_on_null"]["share"] == 0.5
    assert counted["no_verdict_on_null"]["share"] == 0.2
    assert counted["right_name_or_group_by_level"]["2"]["hits"] == 3
    assert counted["two_both_found"]["hits"] == 2
    assert counted["outside_unexplained_or_group"]["hits"] == 2
    assert counted["held_out_chi_squared_per_degree"]["median"] == 1.05
    assert confusion(judged)["one, 2 x limit"]["wrong name"] == 2


def test_seals_stay_shut_until_all_verdicts_are_in(tmp_path):
    (tmp_path / "verdicts").mkdir()
    (tmp_path / "verdicts" / "one-1.json").write_text(json.dumps(verdict("CONSISTENT")))
    with pytest.raises(RuntimeError, match="one-2"):
        opened(tmp_path, ["one-1", "one-2"])


def judged_as(*pairs):
    return [
        {"truth": one, "verdict": said, "outcome": outcome(one, said), "held_out": held_out}
        for one, said, held_out in pairs
    ]


def test_a_workflow_that_is_right_misses_nothing():
    good = judged_as(
        *[(truth("none"), verdict("CONSISTENT"), None)] * 20,
        *[(ONE, verdict("NAMED", ("a",)), 1.0)] * 20,
    )
    assert missed(figures(good)) == []


@pytest.mark.parametrize(
    ("hidden", "said", "held_out", "word"),
    [
        (truth("none"), verdict("NAMED", ("a",)), 1.0, "false_name"),
        (ONE, verdict("CONSISTENT"), None, "right name"),
        (TWO, verdict("NAMED", ("a",)), 1.0, "two"),
        (truth("outside", ()), verdict("NAMED", ("a",)), 1.0, "outside"),
        (ONE, verdict("NAMED", ("a",)), 1.2, "held-out"),
        (
            truth("one", ("a",), expected=[{"a": {"lost_motion": 1.6e-6}}]),
            verdict("NAMED", ("a",)),
            1.0,
            "band",
        ),
        (ONE, {**verdict("NAMED", ("a",)), "seconds": 21.0}, 1.0, "21.0 s"),
    ],
    ids=["names nothing", "sees nothing", "one of two", "least bad", "gap", "band", "slow"],
)
def test_each_fault_of_a_workflow_is_missed_by_its_figure(hidden, said, held_out, word):
    (told,) = missed(figures(judged_as(*[(hidden, said, held_out)] * 6)))
    assert word in told


SETUPS = [("linear", "x", ""), ("step_diagonal", "npp", "YZX")]
SLIP = {"setup": 1, "repeat": 0, "direction": "forward", "stop": 22}
PLACE = {"line": "npp", "order": "YZX", "repeat": 0, "direction": "forward", "from_stop": 21}


@pytest.mark.parametrize(
    ("effect", "its_setting", "kind", "setting", "same"),
    [
        ("backlash", {"axis": "X"}, "backlash", {"axis": "X"}, True),
        ("backlash", {"axis": "Y"}, "backlash", {"axis": "X"}, False),
        ("settling", {"axis": "X"}, "backlash", {"axis": "X"}, False),
        ("thermal growth", {"axis": "X"}, "growth", {"axis": "X"}, True),
        ("growth with time", {"axis": "X"}, "growth", {"axis": "X"}, False),
        ("growth with time", {"axis": "X"}, "growth_in_time", {"axis": "X"}, True),
        ("angular error", {"error": "E_CZ"}, "angular", {"error": "E_CZ"}, True),
        ("angular error", {"error": "E_CZ"}, "angular", {"error": "E_BZ"}, False),
        ("fringe slip", PLACE, "slip", SLIP, True),
        ("fringe slip", {**PLACE, "from_stop": 19}, "slip", SLIP, False),
        ("fringe slip", {**PLACE, "repeat": 1}, "slip", SLIP, False),
        ("fringe slip", {**PLACE, "line": "ppp"}, "slip", SLIP, False),
        ("cosine error", {"setup": "npp YZX"}, "cosine", {"setup": 1}, True),
        ("cosine error", {"setup": "x"}, "cosine", {"setup": 1}, False),
        ("sag", {"error": "Z", "over": "XY"}, "sag", {"component": "z", "pair": "xy"}, True),
        ("sag", {"error": "Z", "over": "XZ"}, "sag", {"component": "z", "pair": "xy"}, False),
    ],
)
def test_words_of_the_catalogue_mean_what_is_hidden(effect, its_setting, kind, setting, same):
    words = ", ".join(str(value) for value in its_setting.values())
    entry = Entry(effect, its_setting, f"{effect} of {words}")
    assert means(entry, kind, setting, SETUPS) is same


def test_a_workflow_that_does_not_end_has_no_answer():
    with pytest.raises(NoAnswerError), limited(1):
        while True:
            pass
