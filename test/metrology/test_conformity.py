"""Decision rule of ISO 14253-1: what is proven, and what is not."""

from math import nan

import pytest

from stepdiag_ros.metrology.standards.conformity import Conformity, conformity


@pytest.mark.parametrize(
    ("value", "uncertainty", "tolerance", "known", "proven"),
    [
        (7.0, 1.0, 8.0, {}, Conformity.WITHIN),
        (7.0, 1.01, 8.0, {}, Conformity.UNDECIDED),
        (9.0, 1.0, 8.0, {}, Conformity.UNDECIDED),
        (9.01, 1.0, 8.0, {}, Conformity.NOT_WITHIN),
        (7.0, 1.0, nan, {}, Conformity.NOT_ASKED),
        (nan, 1.0, 8.0, {}, Conformity.UNDECIDED),
        (7.0, nan, 8.0, {}, Conformity.UNDECIDED),
        (7.0, 0.1, 8.0, {"more_acts": True}, Conformity.UNDECIDED),
        (9.0, 0.1, 8.0, {"more_acts": True}, Conformity.UNDECIDED),
        (9.0, 0.1, 8.0, {"noise": True}, Conformity.UNDECIDED),
        (7.0, 0.1, 8.0, {"noise": True}, Conformity.WITHIN),
        (7.0, 0.1, nan, {"more_acts": True}, Conformity.NOT_ASKED),
    ],
)
def test_conformity_is_proven_only_with_the_uncertainty(
    value, uncertainty, tolerance, known, proven
):
    assert conformity(value, uncertainty, tolerance, **known) is proven


def test_a_limit_is_kept_only_if_it_is_kept_at_every_place():
    assert conformity(8.0, 1.0, 10.0, upper_bound=9.5) is Conformity.WITHIN
    assert conformity(8.0, 1.0, 10.0, upper_bound=11.0) is Conformity.UNDECIDED
    # What exceeds the limit at one place exceeds it.
    assert conformity(12.0, 1.0, 10.0, upper_bound=15.0) is Conformity.NOT_WITHIN
