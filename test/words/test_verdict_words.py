"""What a table of visibility says of an error, in one phrase that can be read by itself."""

import pytest

from stepdiag_ros.metrology.solvers.verdicts import (
    CONFOUNDED,
    DETERMINED,
    INVISIBLE,
    PARTLY,
    VerdictRow,
)


def row(status, **given):
    return VerdictRow("E_XX", "m", status, **given)


@pytest.mark.parametrize("status", [PARTLY, CONFOUNDED, INVISIBLE])
def test_what_can_do_the_same_is_named(status):
    words = row(status, part="the shape", confounded_with=("E_AY", "E_CY")).words
    assert words.startswith(status) and "E_AY, E_CY" in words


def test_the_part_that_is_determined_is_named():
    assert "the shape" in row(PARTLY, part="the shape", confounded_with=("E_AY",)).words


def test_an_error_that_nothing_else_stands_for_says_why_it_is_not_determined():
    alone = row(CONFOUNDED).words
    assert "another shape of it" in alone
    assert "no line" in row(INVISIBLE).words
    assert row(DETERMINED).words == DETERMINED
