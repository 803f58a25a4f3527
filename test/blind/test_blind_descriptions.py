"""How far what is described is from what is hidden."""

from dataclasses import replace

import numpy as np
import pytest
from blind_cases import draw_case
from blind_descriptions import beyond_names, described_errors
from blind_drivers import facts_of
from blind_machine import Machine
from blind_plans import box_places

SIZE = 2e-6


@pytest.fixture(scope="module")
def hidden():
    """A case of sag with three axes: case, facts, run, the same run all over the box."""
    case = draw_case("outside", 0, largest=900)
    machine = Machine(case.seed, case.plan)
    machine.approach[:] = 0.0
    run = machine.run()
    box = replace(run, position=box_places(case.plan.step, case.plan.blocks, len(run.time)))
    return case, facts_of(case.hidden[0], run), run, box


def amounts(case, run):
    """Displacement along the beams, m, (n,)."""
    return np.sum(case.hidden[0].act(run, SIZE).shift.sum(axis=0) * run.beam, axis=1)


def curve(run):
    return 1e-6 * np.sin(run.position[:, 0] / 0.05) * run.beam[:, 1]


def tilt(run):
    across = np.linalg.svd(run.beam[-1:])[2][1]
    return 1e-5 * run.position @ across * (run.setup == run.setup[-1])


def zero(run):
    return 1e-6 * (run.setup == 3)


@pytest.mark.parametrize("unseen", [curve, tilt, zero])
def test_what_nothing_can_see_is_no_error_of_a_description(unseen, hidden):
    case, facts, run, box = hidden
    told = {
        name: amounts(case, one) + unseen(one) for name, one in (("at_stops", run), ("in_box", box))
    }
    errors = described_errors(case, (SIZE,), facts, told)
    # The exact machine's second order is left: tilts of the beam times the displacement.
    assert max(errors.values()) < 2e-3


def test_a_description_that_is_a_tenth_too_small_is_a_tenth_off(hidden):
    case, facts, run, box = hidden
    told = {"at_stops": 0.9 * amounts(case, run), "in_box": 0.9 * amounts(case, box)}
    errors = described_errors(case, (SIZE,), facts, told)
    assert errors == pytest.approx({"at_stops": 0.1, "in_box": 0.1}, abs=2e-3)


def test_a_description_that_is_right_on_the_lines_alone_is_off_in_the_box(hidden):
    case, facts, run, _ = hidden
    told = {"at_stops": amounts(case, run), "in_box": np.zeros(len(run.time))}
    errors = described_errors(case, (SIZE,), facts, told)
    assert errors["at_stops"] < 2e-3 and errors["in_box"] == pytest.approx(1.0)


def test_what_is_no_displacement_is_compared_in_the_readings_alone(hidden):
    case, facts, run, _ = hidden
    facts = {**facts, "drivers": {**facts["drivers"], "in_box": False}}
    told = {"at_stops": amounts(case, run), "in_box": np.zeros(len(run.time))}
    assert described_errors(case, (SIZE,), facts, told)["in_box"] is None


def test_what_is_hidden_beyond_names_is_what_they_leave_of_it(hidden):
    """By a name that does half of what is hidden, and one that does something else."""
    case, _, run, _ = hidden
    truth = {"noise": 1e-7}
    true = SIZE * Machine(case.seed, case.plan).signature(run, case.hidden[0])
    other = np.random.default_rng(1).normal(size=len(true))
    assert beyond_names(case, (SIZE,), truth, [0.5 * true]) < 1e-6
    left = beyond_names(case, (SIZE,), truth, [true + 3e-8 * other])
    assert 1.0 < left < beyond_names(case, (SIZE,), truth, [other])
    assert left == pytest.approx(
        2.0 * beyond_names(case, (0.5 * SIZE,), truth, [true + 3e-8 * other])
    )
