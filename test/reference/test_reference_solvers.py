"""Every solver against certified values (see certify_solvers.py): how many digits agree.

``pytest -s`` prints the table.
"""

import numpy as np
import pytest
from certified import digits_at_hand, matching_digits, measurement_of, names_of, read

from stepdiag_ros.metrology.solvers import solve, solvers
from stepdiag_ros.metrology.solvers.noise_factor import widening

CASES = [
    (problem, method)
    for problem in names_of("solver")
    for method in read(problem)["certified"]
    if method in solvers()
]
LOST = 1.0
"""Digits that a hundred roundings lose of those that are at hand, their signs being by chance."""
FIRST_ORDER_ONLY = {"solver_diagonals_alone": 3.0}
"""Without linear lines two scales are free. What does not depend on them to the first order, does
so by their product with the tilts: some 1e-5 by 1e-4 rad beside squareness of 1e-5 rad.
"""


def worst(pairs):
    return min(pairs, key=lambda pair: pair[1], default=("", 16.0))


@pytest.mark.parametrize(("name", "method"), CASES)
def test_digits(name, method):
    problem = read(name)
    answer = problem["certified"][method]
    result = solve(measurement_of(problem), method)
    curves = worst(
        (curve, matching_digits(result.curves[curve], values, problem["size_m"]))
        for curve, values in answer["curves"].items()
    )
    extent = min(step * problem["blocks"] for step in problem["step_m"])
    figures = worst(
        (
            figure,
            matching_digits(
                [result.figure(figure).value],
                [value],
                problem["size_m"] / (extent if result.figure(figure).unit == "rad" else 1.0),
            ),
        )
        for figure, value in answer["figures"].items()
    )
    # Certified are standard deviations. An estimated one is widened by Student's distribution.
    estimated = name == "solver_unknown_noise"
    wide = np.sqrt(widening(result.degrees_of_freedom)) if estimated else 1.0
    uncertainties = worst(
        (curve, matching_digits(result.standard_uncertainty[curve] / wide, values))
        for curve, values in answer.get("standard_uncertainty", {}).items()
        if any(float(value) for value in values)
    )
    at_hand = digits_at_hand(problem)
    demanded = FIRST_ORDER_ONLY.get(name, at_hand - LOST)
    print(
        f"\n{name:17s} {method:13s} at hand {at_hand:4.1f}  "
        f"curves {curves[1]:4.1f} ({curves[0]:4s})  figures {figures[1]:4.1f} ({figures[0]})  "
        f"uncertainties {uncertainties[1]:4.1f}  demanded {demanded:3.1f}",
        end="",
    )
    assert curves[1] >= demanded, curves
    assert figures[1] >= demanded, figures
    assert uncertainties[1] >= 9.0, uncertainties
    if method == "least_squares":
        assert result.degrees_of_freedom == answer["degrees_of_freedom"]
        if problem["noise_m"] and np.isfinite(result.chi_squared):
            assert matching_digits([result.chi_squared], [answer["squares"]]) >= 5.0


def test_well_conditioned_problems_have_nine_digits_at_hand():
    """So that the demand above is a demand: it is derived from the numbers, not from results."""
    for name in ("paper_size", "noise_free", "unequal_steps", "one_block", "unequal_weights"):
        assert digits_at_hand(read(f"solver_{name}")) > 10.0
    assert digits_at_hand(read("solver_badly_scaled")) < 8.0


def test_uncertainties_are_those_of_the_nominal_setup():
    """The covariance is taken at the nominal setup; at the minimum it differs by the tilts."""
    for name in names_of("solver"):
        answer = read(name)["certified"]["least_squares"]
        tilt = read(name)["tilt_rad"]
        for curve, values in answer.get("standard_uncertainty_at_minimum", {}).items():
            moved = np.array([float(value) for value in values])
            nominal = np.array([float(value) for value in answer["standard_uncertainty"][curve]])
            assert np.all(np.abs(moved - nominal) <= 100.0 * tilt * nominal + 1e-18), name


def test_the_certified_values_can_be_made_again():
    """The stored problem and its answers are what the generating script makes (the smallest)."""
    import certify_solvers

    (problem,) = [p for p in certify_solvers.problems() if p.name == "one_block"]
    made = certify_solvers.document(problem.measure())
    stored = read("solver_one_block")
    assert made["certified"] == stored["certified"]
    assert [line["reading_m"] for line in made["lines"]] == [
        line["reading_m"] for line in stored["lines"]
    ]
