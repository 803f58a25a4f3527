"""No test holds a message to its wording: tests ask for class, fields, names and numbers."""

import ast
import errno
import pickle
from pathlib import Path

import pytest
from refused import a_fault, refused

from stepdiag_ros.bags.errors import BagCutError
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.refusal import Lost, Refusal, Silent, Unusable, fields_of

TESTS = Path(__file__).parents[1]


def matched(tree):
    """Return the lines in which an error or a warning is asked for by a pattern of its text."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        if node.func.attr in ("raises", "warns") and "match" in {one.arg for one in node.keywords}:
            yield node.lineno


def test_no_test_matches_the_wording_of_an_error():
    found = {
        f"{path.relative_to(TESTS)}:{line}"
        for path in TESTS.rglob("*.py")
        for line in matched(ast.parse(path.read_text()))
    }
    assert found == set(), "ask for the error's class, fields, names and numbers (refused.py)"


def test_the_rule_finds_a_pattern():
    def lines(text):
        return list(matched(ast.parse(text)))

    assert lines("pytest.raises(ValueError, match='is no number')") == [1]
    assert lines("with pytest.raises(ValueError, match=said) as caught:\n    pass") == [1]
    assert lines("pytest.raises(ValueError)\nre.sub(text, match='is no number')") == []


@pytest.mark.parametrize("kind", [Refusal, Lost, Silent, Unusable, BagCutError])
def test_an_error_keeps_its_fields_on_its_way_between_processes(kind):
    error = kind("a.csv, row 3: bad", fault="malformed", about="x_m", where="a.csv", row=3)
    came = pickle.loads(pickle.dumps(error))
    assert type(came) is kind
    assert str(came) == "a.csv, row 3: bad"
    assert fields_of(came) == fields_of(error)
    assert (came.fault, came.about, came.where, came.row) == ("malformed", "x_m", "a.csv", 3)


def test_an_error_of_the_computer_keeps_its_number():
    error = Unusable(errno.ENOSPC, "No space left", fault="unwritable")
    assert (error.errno, error.strerror, error.fault) == (
        errno.ENOSPC,
        "No space left",
        "unwritable",
    )


def test_fields_go_on_to_an_error_that_says_more():
    with pytest.raises(Refusal) as caught:
        Section({"blocks": "many"}, "plan").integer("blocks", 1, 10)
    fields = fields_of(caught.value)
    assert fields["about"] == "blocks" and fields["where"] == "plan"
    assert fields_of(ValueError("any")) == {}


@pytest.mark.parametrize(
    "asked",
    [
        a_fault("unknown"),
        a_fault("malformed", "y_m"),
        a_fault("malformed", "19"),
        a_fault("malformed", "1"),
        a_fault("malformed", row=4),
        a_fault("malformed", about="y_m"),
        a_fault("malformed", "is no number"),
    ],
)
def test_what_is_asked_of_an_error_can_fail(asked):
    with pytest.raises(AssertionError), refused(Refusal, asked):
        raise Refusal(
            "t.csv, row 3: 'x_m' is no number: 119", fault="malformed", about="x_m", row=3
        )


def test_what_is_asked_of_an_error_can_be_met():
    with refused(Refusal, "malformed", "t.csv", "119", about="x_m", row=3):
        raise Refusal(
            "t.csv, row 3: 'x_m' is no number: 119", fault="malformed", about="x_m", row=3
        )
