"""How near a plan comes to the ends of the travel, and which line leaves it."""

from dataclasses import replace

import pytest

from stepdiag_ros.configuration import load_machine, load_plan
from stepdiag_ros.run.feasibility import beyond_machine, least_clearance


@pytest.fixture(scope="module")
def plan():
    return load_plan("demo")[0]


def test_the_nearest_end_of_the_travel_is_found(plan):
    machine = replace(load_machine("demo")[0], travel_low_m=(-0.05, -0.004, -0.05))
    distance, axis = least_clearance(plan, machine)
    # The box begins at 0 and no line of this plan has a run-up.
    assert axis == "Y" and distance == pytest.approx(0.004)
    assert not beyond_machine(plan, machine)


def test_a_run_up_counts_and_may_lie_beyond_the_travel(plan):
    machine = replace(load_machine("demo")[0], travel_low_m=(-0.05, -0.004, -0.05))
    distance, axis = least_clearance(replace(plan, overrun=0.01), machine)
    assert axis == "Y" and distance == pytest.approx(0.004 - 0.01)
    assert beyond_machine(replace(plan, overrun=0.01), machine)


def test_a_plan_in_millimetres_is_recognized(plan):
    machine = load_machine("demo")[0]
    millimetres = replace(plan, volume=replace(plan.volume, step=(10.0,) * 3))
    assert "0.12 m" in beyond_machine(millimetres, machine)
    too_long = replace(plan, volume=replace(plan.volume, step=(0.1,) * 3))
    assert "meant" not in beyond_machine(too_long, machine)
