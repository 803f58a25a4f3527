"""Does a pass that disagrees with the others show, and no other? Checked against plain algebra."""

from dataclasses import replace

import numpy as np
import pytest
from random_machines import PLACES, any_measurement

from stepdiag_ros.metrology.tracker.agreement import departures, familywise
from stepdiag_ros.metrology.tracker.evaluation import evaluate_test
from stepdiag_ros.metrology.tracker.readings import LOCATE, TrackerReading
from stepdiag_ros.metrology.tracker.verdict import verdict_on


def pass_of(reading):
    return reading.line, reading.run, reading.direction


def machine(number):
    """Return a random machine with every kind of error, measured from one of six places."""
    rng = np.random.default_rng([77, number])
    how = {"runs": int(rng.integers(2, 5)), "targets": int(rng.integers(6, 11))}
    return any_measurement(77 + number, list(PLACES)[number % len(PLACES)], **how)


def estimate(one, readings=None):
    return evaluate_test(one.readings if readings is None else readings, chain=one.cell.chain).joint


def test_a_departure_is_what_leaving_the_pass_out_predicts():
    """By the inverse of the whole covariance, which the module never makes."""
    rng = np.random.default_rng(5)
    count, free, random = 24, 3, 6
    design = rng.standard_normal((count, free + random))
    noise = rng.uniform(0.5, 2.0, count)
    sizes = rng.uniform(0.3, 3.0, random)
    y = rng.standard_normal(count) * 3.0
    x, z = design[:, :free], design[:, free:]
    penalty = np.diag([0.0] * free + list(1.0 / sizes**2))
    inverse = np.linalg.inv(design.T @ np.diag(noise**-2) @ design + penalty)
    solution = inverse @ design.T @ (y / noise**2)
    readings = [
        TrackerReading("1", line, 1, "forward", stop, (0.0, 0.0, float(stop)))
        for line in ("x", "y", "z")
        for stop in range(8)
    ]
    found = departures(readings, y - design @ solution, noise, design, inverse)
    whole = np.diag(noise**2) + z @ np.diag(sizes**2) @ z.T
    for number, one in enumerate(found):
        inside = np.arange(8 * number, 8 * number + 8)
        others = np.setdiff1d(np.arange(count), inside)
        precision = np.linalg.inv(whole[np.ix_(others, others)])
        spread = np.linalg.inv(x[others].T @ precision @ x[others])
        beta = spread @ x[others].T @ precision @ y[others]
        gain = whole[np.ix_(inside, others)] @ precision
        predicted = x[inside] @ beta + gain @ (y[others] - x[others] @ beta)
        left = x[inside] - gain @ x[others]
        covariance = (
            whole[np.ix_(inside, inside)]
            - gain @ whole[np.ix_(others, inside)]
            + left @ spread @ left.T
        )
        away = y[inside] - predicted
        assert one.chi_squared == pytest.approx(away @ np.linalg.solve(covariance, away), rel=1e-9)
        assert one.rms == pytest.approx(float(np.sqrt(np.mean(away**2))), rel=1e-9)


def test_machines_with_every_kind_of_error_agree_with_themselves():
    chances, singles = [], []
    for number in range(24):
        passes = estimate(machine(number)).passes
        chances.append(familywise(passes)[1])
        singles += [one.p_value for one in passes]
    assert sum(chance < 0.01 for chance in chances) <= 2
    # χ² is what it claims to be: uniform chances (of hundreds of passes).
    assert np.mean(np.array(singles) < 0.05) == pytest.approx(0.05, abs=0.03)
    assert np.mean(np.array(singles) < 0.5) == pytest.approx(0.5, abs=0.07)


@pytest.mark.parametrize("number", [0, 1, 3, 5])
def test_a_slipped_count_is_found_in_its_pass(number):
    one = machine(number)
    rng = np.random.default_rng(number)
    passes = list(dict.fromkeys(pass_of(r) for r in one.readings if r.line != LOCATE))
    slipped = passes[int(rng.integers(len(passes)))]
    members = [index for index, r in enumerate(one.readings) if pass_of(r) == slipped]
    late = set(members[len(members) // 2 :])
    readings = tuple(
        replace(r, change=r.change + 3e-6) if index in late else r
        for index, r in enumerate(one.readings)
    )
    joint = estimate(one, readings)
    worst, chance = familywise(joint.passes)
    assert (worst.line, worst.run, worst.direction) == slipped
    assert chance < 0.01
    assert verdict_on(joint)[0] == "UNEXPLAINED"
    assert verdict_on(estimate(one))[0] == "CONSISTENT"


def test_nothing_is_said_without_an_estimate():
    assert verdict_on(None)[0] == "NOT TESTABLE"
    assert familywise(()) == (None, 1.0)
