"""How the blind test judges: outcomes, bounds, seals that stay shut, and the words it compares."""

import json

import pytest
from blind_asking import NoAnswerError, limited
from blind_document import BEGIN, END, not_right, put_into, results
from blind_figures import clopper_pearson, confusion, figures, missed
from blind_harness import opened
from blind_judging import NO_PLAN, after_plan, covered, outcome
from blind_schedule import wanted_cases
from blind_words import Entry, means, quantities_of, rightly_said
from refused import refused

MEANING = {"a": ("backlash", {"axis": "X"}), "b": ("settling", {"axis": "Y"})}
"""Label → effect and setting that it stands for; "a too" is another name of a."""
MEANING["a too"] = MEANING["a"]


def verdict(word, *findings, **further):
    made = [
        {
            "label": label,
            "effect": "learned shape" if word == "DESCRIBED" else "effect",
            "ambiguous": list(others),
            "band": {"lost_motion": [0.5e-6, 1.5e-6]},
        }
        for label, *others in findings
    ]
    words = [
        [*MEANING.get(label, ("drift", {"along": "Z"})), label]
        for labels in findings
        for label in labels
    ]
    return {
        "verdict": word,
        "findings": made,
        "words": words,
        "untestable": [],
        "where": [],
        "sentence": word,
        "seconds": 1.0,
        "readings": 2000,
        **further,
    }


def described(*dependences, beside=(), **further):
    """A verdict DESCRIBED by (acts_on, drivers, *rivals)."""
    told = [
        {"acts_on": acts_on, "drivers": list(drivers), "rivals": list(rivals)}
        for acts_on, drivers, *rivals in dependences
    ]
    said = verdict("DESCRIBED", ("shape",), description={"dependences": told}, **further)
    said["findings"] += verdict("NAMED", *beside)["findings"]
    return said


X, Z, AIR = "the place of X", "the place of Z", "the air temperature"
HIDDEN = {
    "a": {"kind": "backlash", "setting": {"axis": "X"}},
    "b": {"kind": "settling", "setting": {"axis": "Y"}},
    "hidden scale": {"kind": "scale", "setting": {"axis": "Y"}},
    "outside": {"kind": "cubic_sag", "setting": {"component": "z"}},
}


def truth(kind, *hidden, level=2.0, expected=(), **further):
    return {
        "class": kind,
        "hidden": [HIDDEN[one] for one in hidden],
        "level": level,
        "expected": list(expected),
        "scaled_by": "workflow",
        "setups": [],
        "repeats": 0,
        "jumps": [],
        "one_temperature": False,
        "drivers": {"acts_on": ["Y"], "quantities": ["place X", "place Z"], "lasting": True},
        **further,
    }


ONE = truth("one", "a")
TWO = truth("two", "a", "b", level=5.0)
OUTSIDE = truth("outside", "outside", level=3.0)
PASSING = truth(
    "outside",
    "outside",
    level=3.0,
    drivers={"acts_on": ["reading"], "quantities": ["time"], "lasting": False},
)
UNSEEN = truth("unseen", "hidden scale")
SCALE_UNTESTABLE = [["scale", {"axis": "Y"}, "scale of Y"]]
JUDGED = [
    (truth("none"), verdict("CONSISTENT"), "right"),
    (truth("none"), verdict("NAMED", ("a",)), "wrong name"),
    (truth("none"), verdict("AMBIGUOUS", ("a", "b")), "wrong name"),
    (truth("none"), verdict("UNEXPLAINED"), "unexplained"),
    (truth("none"), verdict("NOT TESTABLE"), "no verdict"),
    (ONE, verdict("NO ANSWER"), "no verdict"),
    (ONE, verdict("NAMED", ("a too",)), "right"),
    (ONE, verdict("NAMED", ("a", "b")), "right, in a group"),
    (ONE, verdict("AMBIGUOUS", ("a", "a too")), "right"),
    (ONE, verdict("CRASH"), "no verdict"),
    (ONE, verdict("AMBIGUOUS", ("b", "a")), "right, in a group"),
    (ONE, verdict("AMBIGUOUS", ("b", "c")), "wrong name"),
    (ONE, verdict("NAMED", ("a",), ("c",)), "wrong name"),
    (ONE, verdict("CONSISTENT"), "consistent"),
    (ONE, verdict("UNEXPLAINED"), "unexplained"),
    (TWO, verdict("NAMED", ("a",), ("b",)), "right"),
    (TWO, verdict("AMBIGUOUS", ("a",), ("c", "b")), "right, in a group"),
    (TWO, verdict("NAMED", ("a",)), "consistent"),
    (TWO, verdict("NAMED", ("a",), ("c",)), "wrong name"),
    (OUTSIDE, described(("Y", (X, Z))), "right"),
    (OUTSIDE, described(("Y", (X,)), ("Y", (Z,))), "right"),
    (OUTSIDE, described(("Y", (X, Z), ["Y", [X]])), "right"),
    (OUTSIDE, described(("Y", (X, Z), ["Y", [X, AIR]])), "right, with its rival"),
    (OUTSIDE, described(("Z", (X,), ["Y", [X, Z]])), "right, with its rival"),
    (OUTSIDE, described(("Z", (X, Z))), "wrong description"),
    (OUTSIDE, described(("Y", (X,))), "wrong description"),
    (OUTSIDE, described(("Y", (X, Z)), ("Y", (AIR,))), "wrong description"),
    (OUTSIDE, described(("Y", (X, "the moon"))), "wrong description"),
    (OUTSIDE, described(("Y", (X, Z)), beside=[("a",)]), "wrong name"),
    (OUTSIDE, verdict("UNEXPLAINED"), "unexplained"),
    (PASSING, verdict("UNEXPLAINED"), "right"),
    (PASSING, described(("reading", ("time",))), "right"),
    (PASSING, described(("reading", ("time, periodically",))), "wrong description"),
    (PASSING, verdict("NAMED", ("a",)), "wrong name"),
    (truth("none"), described(("Y", (X, Z))), "wrong name"),
    (ONE, described(("Y", (X, Z))), "unexplained"),
    (OUTSIDE, verdict("AMBIGUOUS", ("a", "b")), "right, in a group"),
    (OUTSIDE, verdict("AMBIGUOUS", ("a", "b"), ("c",)), "wrong name"),
    (OUTSIDE, verdict("NAMED", ("a",)), "wrong name"),
    (OUTSIDE, verdict("CONSISTENT"), "consistent"),
    (UNSEEN, verdict("CONSISTENT", untestable=SCALE_UNTESTABLE), "right"),
    (UNSEEN, verdict("CONSISTENT"), "consistent"),
    (UNSEEN, verdict("NAMED", ("a",)), "wrong name"),
    (UNSEEN, verdict("UNEXPLAINED"), "unexplained"),
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
    inside = truth("one", "a", expected=[{"a": {"lost_motion": 1e-6}}])
    outside = truth("one", "a", expected=[{"a": {"lost_motion": 1.6e-6}}])
    elsewhere = truth("one", "a", expected=[{"a too": {"lost_motion": 1e-6}}])
    assert covered(inside, said) == [True]
    assert covered(outside, said) == [False]
    assert covered(elsewhere, said) == []


def judged_as(*runs):
    return [
        {
            "name": f"{one['class']}-{number}",
            "truth": one,
            "verdict": said,
            "outcome": outcome(one, said),
            "after_plan": after_plan(one, said),
            "held_out": held_out,
            "described_errors": {"in_box": 0.1, "at_stops": 0.05}
            if one["class"] == "outside" and said["verdict"] == "DESCRIBED"
            else None,
            "beyond_names": 3.0 if said["verdict"] == "AMBIGUOUS" else None,
        }
        for number, (one, said, held_out) in enumerate(runs)
    ]


def test_the_figures_count_what_they_say():
    judged = judged_as(
        *[
            (hidden, said, 1.05 if said["verdict"] in ("NAMED", "DESCRIBED") else None)
            for hidden, said, _ in JUDGED
        ]
    )
    counted = figures(judged)
    assert counted["false_name_on_null"]["hits"] == 3
    assert counted["no_verdict_on_null"]["hits"] == 1
    assert counted["right_name_or_group_at_2"]["hits"] == 4
    assert counted["two_both_found"]["hits"] == 2
    outside = counted["outside_described_rightly"]
    assert (outside["hits"], outside["runs"]) == (3, 15)
    assert counted["outside_described_or_rival"]["hits"] == 5
    assert counted["outside_description_right_whatever_rivals"]["hits"] == 4
    assert counted["outside_wrong_description"]["hits"] == 4
    assert counted["outside_in_a_group"]["hits"] == 1
    assert counted["outside_beyond_names"]["median"] == 3.0
    assert counted["outside_unexplained"]["hits"] == 1
    assert counted["outside_wrong_lone_name"]["hits"] == 4
    passing = counted["passing_unexplained_or_in_time"]
    assert (passing["hits"], passing["runs"]) == (2, 4)
    assert counted["described_held_out"]["median"] == 1.05
    assert counted["described_error_in_box"]["median"] == 0.1
    assert counted["unseen_said_not_testable"]["hits"] == 1
    assert counted["unseen_named"]["hits"] == 1
    assert counted["crashes"]["hits"] == 1
    assert counted["held_out_chi_squared"]["median"] == 1.05
    assert confusion(judged)["one, 2 ×"]["wrong name"] == 2


def test_two_that_could_not_both_be_large_do_not_count_as_five_times_the_limit():
    small = truth("two", "a", "b", level=0.5)
    counted = figures(judged_as((small, verdict("CONSISTENT"), None)))
    assert counted["two_both_found"]["runs"] == 0


def test_what_became_of_a_group_after_the_proposed_plan():
    def after(further):
        return verdict("AMBIGUOUS", ("a", "b"), further={"proposal": {}, "verdict": further})

    judged = judged_as(
        (ONE, after(verdict("NAMED", ("a",))), None),
        (ONE, after(verdict("NAMED", ("b",))), None),
        (ONE, after(verdict("AMBIGUOUS", ("a", "b"))), None),
        (ONE, after(None), None),
        (ONE, verdict("NAMED", ("a",)), 1.0),
    )
    assert [one["after_plan"] for one in judged] == [
        "right",
        "wrong name",
        "right, in a group",
        NO_PLAN,
        None,
    ]
    counted = figures(judged)
    assert (counted["plan_proposed"]["hits"], counted["plan_proposed"]["runs"]) == (3, 4)
    unique = counted["unique_name_after_plan"]
    assert (unique["hits"], unique["runs"]) == (1, 3)
    assert counted["wrong_name_after_plan"]["hits"] == 1
    judged[2]["verdict"]["further"]["proposal"]["left_open"] = [["a", "b"]]
    judged[1]["verdict"]["further"]["proposal"]["left_open"] = [["b", "c"]]
    promised = figures(judged)["unique_name_where_promised"]
    assert (promised["hits"], promised["runs"]) == (1, 2)
    assert confusion(judged)["one, after the plan"]["right"] == 1


def test_what_a_plan_settles_of_something_outside_the_catalogue_counts_with_what_was_right():
    right = ("Y", (X, Z))
    rivalled = ("Z", (X, Z), ("Y", (X, Z)))

    def after(said, further):
        return {**said, "further": {"proposal": {}, "verdict": further}}

    judged = judged_as(
        (OUTSIDE, described(right), None),
        (OUTSIDE, after(described(rivalled), described(right)), None),
        (OUTSIDE, after(verdict("AMBIGUOUS", ("a", "b")), described(rivalled)), None),
        (OUTSIDE, after(verdict("AMBIGUOUS", ("a", "b")), None), None),
    )
    counted = figures(judged)
    settled = counted["outside_described_after_plan"]
    assert (settled["hits"], settled["runs"]) == (2, 4)
    assert counted["outside_described_rightly"]["hits"] == 1
    assert counted["plan_proposed"]["runs"] == 0


def test_what_is_over_after_the_first_run_is_counted_apart():
    over = {**ONE, "hidden": [{"kind": "cosine", "setting": {"setup": 0}}]}
    over["setups"] = [("linear", "x", "")]
    said = verdict("AMBIGUOUS", ("c", "b"))
    said["words"] = [["cosine error", {"setup": "x"}, "c"], ["backlash", {"axis": "X"}, "b"]]
    said["further"] = {"proposal": {}, "verdict": dict(said)}
    judged = judged_as((over, said, None))
    counted = figures(judged)
    assert counted["unique_name_after_plan"]["runs"] == 0
    assert counted["name_or_group_of_what_is_over_after_plan"]["hits"] == 1


def gross(kind, **where):
    made = truth("gross", gross={"kind": kind, **where})
    return {**made, "setups": [("step_diagonal", "ppp", "XYZ")]}


@pytest.mark.parametrize(
    ("hidden", "said", "expected"),
    [
        (
            gross("reversed_axis", axis="Y"),
            verdict("UNEXPLAINED", where=["Y runs backwards on every line: its readings …"]),
            "right",
        ),
        (gross("reversed_axis", axis="X"), verdict("UNEXPLAINED"), "unexplained"),
        (gross("millimetres"), verdict("UNEXPLAINED", where=["readings are in mm"]), "right"),
        (
            gross("wrong_line", line="pnp"),
            verdict("UNEXPLAINED", sentence="agree if what is called ppp XYZ was measured as pnp."),
            "right",
        ),
        (
            gross("wrong_line", line="npp"),
            verdict("UNEXPLAINED", sentence="agree if what is called ppp XYZ was measured as pnp."),
            "unexplained",
        ),
        (gross("repeated_row"), verdict("REFUSED", sentence="the row is there twice"), "right"),
        (gross("repeated_row"), verdict("REFUSED", sentence="it is no number"), "unexplained"),
        (gross("outlier", setup=0, stop=4), verdict("NAMED", ("a",)), "wrong name"),
        (gross("sign"), verdict("CONSISTENT"), "consistent"),
        (gross("sign"), verdict("CRASH"), "no verdict"),
    ],
)
def test_a_gross_error_is_right_where_it_is_called_by_its_name(hidden, said, expected):
    assert outcome(hidden, said) == expected


@pytest.mark.parametrize(("stop", "expected"), [(4, "right"), (9, "wrong name")])
def test_a_wrong_digit_may_be_called_two_jumps_at_its_place(stop, expected):
    hidden = gross("outlier", setup=0, stop=4)
    place = {"line": "ppp", "order": "XYZ", "direction": "forward", "repeat": 0}
    said = verdict("NAMED", ("there",), ("back",))
    said["words"] = [
        ["beam-break jump", {**place, "from_stop": one}, label]
        for one, label in ((stop, "there"), (stop + 1, "back"))
    ]
    assert outcome(hidden, said) == expected


def test_a_half_reading_is_not_any_wrong_reading():
    assert rightly_said({"kind": "half"}, "its readings are half of what they should be", False)
    assert not rightly_said({"kind": "half"}, "its readings are 0.7 times …", False)


def test_results_are_put_into_the_marked_part_and_nowhere_else(tmp_path):
    judged = judged_as(
        (truth("none"), verdict("CONSISTENT"), None),
        (ONE, verdict("NAMED", ("b",)), 1.0),
        (gross("sign"), verdict("UNEXPLAINED"), None),
    )
    assert [one["name"] for one in not_right(judged)] == ["one-1", "gross-2"]
    document = tmp_path / "blind.md"
    document.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    put_into(document, results(judged, ["seeds from 0 on"]))
    text = document.read_text()
    assert text.startswith("before\n") and text.endswith("after\n") and "old" not in text
    assert "| a name or DESCRIBED on null data | ≤ 1 % | 0 % (0 of 1) | 0.0-97.5 % |" in text
    assert "| same, at 2 × | ≥ 95 % | 0 % (0 of 1) |" in text
    assert "- `one-1` (backlash X, 2 ×): wrong name; NAMED: b" in text
    put_into(document, results(judged, ["seeds from 0 on"]))
    assert document.read_text() == text
    document.write_text("no part")
    with refused(ValueError, None, "blind.md", "before", "after"):
        put_into(document, text)


def test_classes_are_mixed_and_each_case_is_there_once():
    wanted = wanted_cases({"none": 4, "one": 12}, seed=7)
    assert len(set(wanted)) == 16
    assert {seed for kind, seed, *_ in wanted if kind == "one"} == set(range(7, 19))
    assert sum(level == 2.0 for kind, _, level, _ in wanted if kind == "one") == 6
    assert {kind for kind, *_ in wanted[:8]} == {"none", "one"}


def test_seals_stay_shut_until_all_verdicts_are_in(tmp_path):
    (tmp_path / "verdicts").mkdir()
    (tmp_path / "verdicts" / "one-1.json").write_text(json.dumps(verdict("CONSISTENT")))
    with refused(RuntimeError, None, "one-2"):
        opened(tmp_path, ["one-1", "one-2"])


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
        (ONE, verdict("CONSISTENT"), None, "right_name"),
        (TWO, verdict("NAMED", ("a",)), 1.0, "two"),
        (OUTSIDE, verdict("UNEXPLAINED"), None, "outside_described"),
        (PASSING, verdict("NAMED", ("a",)), None, "outside_wrong_lone"),
        (OUTSIDE, described(("Y", (X, Z))), 1.08, "described_held_out"),
        (ONE, verdict("NAMED", ("a",)), 1.2, "held-out"),
        (
            truth("one", "a", expected=[{"a": {"lost_motion": 1.6e-6}}]),
            verdict("NAMED", ("a",)),
            1.0,
            "band",
        ),
        (ONE, verdict("NAMED", ("a",), seconds=6.0), 1.0, "seconds"),
        (
            ONE,
            verdict(
                "AMBIGUOUS",
                ("a", "b"),
                further={"proposal": {}, "verdict": verdict("AMBIGUOUS", ("a", "b"))},
            ),
            None,
            "unique_name",
        ),
        (ONE, verdict("CRASH"), None, "crashes"),
    ],
    ids=[
        "names nothing",
        "sees nothing",
        "one of two",
        "describes nothing",
        "least bad",
        "description does not hold",
        "gap",
        "band",
        "slow",
        "plan in vain",
        "crash",
    ],
)
def test_each_fault_of_a_workflow_is_missed_by_its_figure(hidden, said, held_out, word):
    told = missed(figures(judged_as(*[(hidden, said, held_out)] * 60)))
    assert [one for one in told if word in one]
    assert len(told) == 1 or word == "crashes"


def test_one_verdict_that_takes_too_long_is_missed():
    runs = [(ONE, verdict("NAMED", ("a",), seconds=seconds), 1.0) for seconds in [1.0] * 30 + [31]]
    assert [one for one in missed(figures(judged_as(*runs))) if "31" in one]


def test_many_repeats_are_rows_of_their_own():
    many = {**OUTSIDE, "repeats": 12}
    judged = judged_as(
        (OUTSIDE, described(("Y", (X, Z))), 1.0), (many, verdict("UNEXPLAINED"), None)
    )
    counted = figures(judged)
    assert counted["outside_described_rightly"]["runs"] == 1
    few = counted["many_outside_described_rightly"]
    assert (few["hits"], few["runs"]) == (0, 1)
    assert confusion(judged)["outside, 3 ×, many repeats"]["unexplained"] == 1


def test_air_that_has_the_material_s_temperature_is_called_either():
    assert quantities_of([X, AIR]) == {"place X", "air"}
    assert quantities_of([X, AIR], one_temperature=True) == {"place X", "material"}
    assert quantities_of(["the time since Y turned round"]) == {"reversal Y", "sense Y"}


def test_a_loose_mirror_may_be_called_two_jumps_of_the_reading_where_it_jumped():
    hidden = {
        **PASSING,
        "hidden": [{"kind": "loose_mirror", "setting": {"setup": 0}}],
        "setups": [("step_diagonal", "ppp", "XYZ")],
        "jumps": [{"repeat": 0, "direction": "forward", "stop": stop} for stop in (4, 9)],
    }
    place = {"line": "ppp", "order": "XYZ", "direction": "forward", "repeat": 0}
    for stop, expected in ((9, "right, with its rival"), (20, "wrong name")):
        said = verdict("NAMED", ("there",), ("back",))
        said["words"] = [
            ["fringe slip", {**place, "from_stop": one}, label]
            for one, label in ((4, "there"), (stop, "back"))
        ]
        assert outcome(hidden, said) == expected


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
        ("warm-up growth", {"axis": "X"}, "warming_growth", {"axis": "X", "constant": 9.0}, True),
        ("wavy angular error", {"error": "E_CZ"}, "wavy_angular", {"error": "E_CZ"}, True),
        ("mirror tilt under travel", {"setup": "npp YZX"}, "mirror_tilt", {"setup": 1}, True),
        (
            "mirror tilt under travel",
            {"setup": "run 2: npp YZX"},
            "mirror_tilt",
            {"setup": 1},
            False,
        ),
        ("Abbe offset", {"setup": "npp YZX", "axis": "Y"}, "abbe", {"setup": 1, "axis": "Y"}, True),
        (
            "Abbe offset",
            {"setup": "npp YZX", "axis": "X"},
            "abbe",
            {"setup": 1, "axis": "Y"},
            False,
        ),
        ("squareness", {"angle": "B0Z"}, "squareness", {"axis": "X", "component": "Z"}, True),
        ("squareness", {"angle": "C0Y"}, "squareness", {"axis": "X", "component": "Z"}, False),
        ("drift", {"along": "X"}, "drift", {"direction": "x"}, True),
        ("drift", {"along": "the beam"}, "reading_drift", {}, True),
        ("drift", {"along": "X"}, "reading_drift", {}, False),
        (
            "pitch-periodic error",
            {"axis": "X", "period_m": 0.005},
            "pitch",
            {"axis": "X", "period": 0.005},
            True,
        ),
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
