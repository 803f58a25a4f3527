"""Single evaluations against certified values (see certify_functions.py)."""

import json
import math

import numpy as np
import pytest
from certified import EPSILON, FOLDER, matching_digits

from stepdiag_ros.metrology.plan import LINEAR
from stepdiag_ros.metrology.standards.axis_test import BidirectionalRuns
from stepdiag_ros.metrology.standards.diagonal_squareness import (
    DiagonalLength,
    LinearError,
    from_body,
)
from stepdiag_ros.metrology.standards.iso230_2 import evaluate
from stepdiag_ros.metrology.tracker.location import locate

CASES = json.loads((FOLDER / "functions.json").read_text())
LOST = 1.0


def named(kind):
    return pytest.mark.parametrize("case", CASES[kind], ids=lambda case: case["name"])


@named("iso230_2")
def test_iso230_2(case):
    up, down = np.array(case["forward_m"]), np.array(case["backward_m"])
    runs = BidirectionalRuns("X", LINEAR, np.arange(up.shape[1]) * 0.1, up, down)
    found = evaluate(runs).parameters
    at_hand = -math.log10(EPSILON * case["largest_m"] / case["size_m"])
    digits = {
        name: matching_digits([found[name]], [value], case["size_m"])
        for name, value in case["certified"].items()
    }
    print(f"\nISO 230-2 {case['name']}: at hand {at_hand:.1f}, {digits}", end="")
    assert len(digits) == 12
    assert min(digits.values()) >= min(at_hand, 15.0) - LOST, digits


@named("squareness")
def test_squareness_from_body_diagonals(case):
    travel = case["travel_m"]
    lengths = []
    for line, error in case["error_m"].items():
        start = [t if letter == "n" else 0.0 for letter, t in zip(line, travel, strict=True)]
        finish = [0.0 if letter == "n" else t for letter, t in zip(line, travel, strict=True)]
        own = case["standard_uncertainty_m"][line]
        lengths.append(DiagonalLength(line, tuple(start), tuple(finish), error, own))
    found = from_body(lengths, {axis: LinearError(*pair) for axis, pair in case["linear"].items()})
    certified = case["certified"]
    digits = {"mean": matching_digits([found.mean_length_error], [certified["mean"]], 1e-5)}
    for one in found.values:
        digits[one.name] = matching_digits([one.theta], [certified[f"theta {one.name}"]])
    print(f"\nsquareness {case['name']}: {digits}", end="")
    assert len(digits) == 4
    # No large number is in it: the errors themselves are the readings.
    assert min(digits.values()) >= 12.0, digits


@named("tracker")
def test_tracker_position(case):
    points, changes = np.array(case["points_m"]), np.array(case["changes_m"])
    found = locate(points, changes, case["spread_m"])
    largest = max(float(np.max(np.abs(changes))), float(np.max(points)))
    certified = [float(text) for text in case["certified"]]
    extent = float(np.max(np.abs(certified)))
    at_hand = -math.log10(EPSILON * largest * case["dilution"] / extent)
    digits = matching_digits([*found.position, found.start_length], case["certified"], extent)
    print(f"\ntracker {case['name']}: at hand {at_hand:.1f}, {digits:.1f}", end="")
    # Nothing is lost by ending the iteration early.
    assert digits >= at_hand - LOST
