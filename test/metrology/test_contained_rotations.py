"""Which verdicts leave a decision open: rotations that every uncertainty contains do not."""

import pytest

from stepdiag_ros.metrology.discrepancy.summary import FoundEffect, FoundSize, Verdict

PLAUSIBLE = 10e-6


def found(label, size, *rivals):
    one = FoundSize("size", "rad", "", size, 1e-6, (size, size))
    return FoundEffect(label, "", {}, "", "", (one,), 9.0, 1e-3, 0.9, rivals)


SEVERAL, ONE, WAVY = "several angular errors", "angular error E_CZ", "wavy angular error E_AX"


@pytest.mark.parametrize(
    ("name", "effects", "contained"),
    [
        ("NAMED", [found(SEVERAL, 20e-6)], True),
        ("NAMED", [found(ONE, -29e-6)], True),
        ("NAMED", [found(ONE, -31e-6)], False),
        ("NAMED", [found(ONE, 5e-6), found(WAVY, 5e-6)], True),
        ("NAMED", [found(ONE, 5e-6), found("backlash of X", 1e-6)], False),
        ("AMBIGUOUS", [found(ONE, 5e-6, "angular error E_AZ", SEVERAL)], True),
        ("AMBIGUOUS", [found(ONE, 5e-6, "sag along X over X and Z")], False),
        ("NAMED", [found("squareness C0Y", 5e-6)], False),
        ("DESCRIBED", [found(ONE, 5e-6)], False),
        ("UNEXPLAINED", [], False),
    ],
)
def test_rotations_up_to_three_times_the_plausible_size_are_contained(name, effects, contained):
    verdict = Verdict.of_effects(name, "", effects, PLAUSIBLE)
    assert verdict.contained is contained and verdict.more_acts is not contained
    assert verdict.effects == tuple(one.label for one in effects)


def test_a_machine_that_states_larger_rotations_contains_larger_ones():
    effects = [found(ONE, 31e-6)]
    assert Verdict.of_effects("NAMED", "", effects, 2.0 * PLAUSIBLE).contained
    assert not Verdict.of_effects("CONSISTENT", "", (), PLAUSIBLE).more_acts
