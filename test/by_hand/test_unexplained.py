"""A recording whose stops or rests this plan does not explain gives nothing, and says which."""

from dataclasses import replace

import numpy as np
import pytest
from exact_drive import driven, plan_of, stays_of

from stepdiag_ros.metrology.by_hand import find_stops
from stepdiag_ros.metrology.expected_stop import SCALE, TILT, ExpectedStops
from stepdiag_ros.metrology.forward import perpendiculars
from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.rest_matching import Tolerance

BOTH = "forward backward"
UNEVEN = (0.004, 0.03, 0.03)


def refusals(plan, stays):
    found = find_stops(plan, range(len(plan.lines)), driven(stays))
    return [line.refusal for line in found.lines]


def with_volume(plan, **changed):
    return replace(plan, volume=replace(plan.volume, **changed))


PLANS = [
    plan_of("x", repeats=2, directions=BOTH),
    plan_of("ppp", step=UNEVEN, repeats=2, directions=BOTH),
    plan_of("ppp", step=UNEVEN),
]


@pytest.mark.parametrize("plan", PLANS)
def test_the_program_of_the_plan_itself_is_found_whole(plan):
    assert set(refusals(plan, stays_of(plan))) == {""}


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("blocks", [2, 4, 5, 7])
def test_another_number_of_blocks_gives_no_line(plan, blocks):
    assert "" not in refusals(plan, stays_of(with_volume(plan, blocks=blocks)))


@pytest.mark.parametrize("factor", [0.98, 1.02])
def test_steps_that_fit_one_by_one_but_not_together_give_no_line(factor):
    plan = plan_of("x", "y", step=(0.01, 0.01, 0.01))
    program = with_volume(plan, step=(0.01 * factor, 0.01, 0.01))
    stays = stays_of(program)
    along_x, along_y = refusals(plan, [*stays[:4], (0.5, 3.0), *stays[4:]])
    assert (
        along_x.startswith("stop 1 of x forward, repeat 0 stands ")
        and "give the plan whose program ran" in along_x
    )
    # The steps along Y are those of the plan, but who believes that it was this plan?
    assert along_y == along_x


def test_a_rest_beyond_the_ends_of_a_setup_tells_against_its_lines():
    plan = plan_of("x", repeats=2, directions=BOTH)
    stays = stays_of(plan)
    turn = next(n for n, (level, _) in enumerate(stays) if level == pytest.approx(0.03))
    held = [*stays[:turn], (0.026, 2.0), *stays[turn:]]
    assert set(refusals(plan, held)) == {""}
    away = [*stays[: turn + 1], (0.047, 2.0), *stays[turn:]]
    for refusal in refusals(plan, away):
        assert refusal.startswith("the machine stood 17.0000 mm beyond the ends of the setup's")


@pytest.mark.parametrize("dwell", [0.4, 1.0])
def test_a_recording_that_ends_one_step_beyond_a_line_gives_nothing(dwell):
    plan = plan_of("ppp", step=UNEVEN)
    longer = stays_of(with_volume(plan, blocks=4))
    count = len(stays_of(plan))
    assert refusals(plan, longer[:count]) == [""]
    (refusal,) = refusals(plan, [*longer[:count], (longer[count][0], dwell)])
    assert refusal.startswith("the sequence goes on after its last stop: a rest +0.37")


def test_a_line_without_its_first_or_its_last_stop_gives_nothing():
    plan = plan_of("ppp", step=UNEVEN)
    stays = stays_of(plan)
    assert refusals(plan, stays[1:])[0].startswith("its first stop is not in the recording")
    assert refusals(plan, stays[:-1])[0].startswith("its last stop is not in the recording")


def test_the_last_stop_of_a_line_is_read_when_the_machine_comes_there():
    # Later it stands there again, as with another alignment that was zeroed at the same place.
    plan = plan_of("x")
    stays = [*stays_of(plan)[:-1], (0.030002, 1.0), (0.035, 0.0), (0.03, 5.0)]
    (line,) = find_stops(plan, [0], driven(stays)).lines
    assert line.stops[-1].rest.arrived == pytest.approx(0.030002, abs=1e-9)


def expected(plan):
    return ExpectedStops(plan, 0, Tolerance.of_plan(plan))


def readings_at_stops(plan, tilt, scale=0.0):
    """Displacements (m) at the stops of the first line, to first order in the tilt (rad)."""
    line = plan.lines[0]
    beam = beam_direction(line.name, np.asarray(plan.volume.step))
    effective = (1.0 + scale) * beam + tilt * perpendiculars(beam)[0]
    stops = line.stops(plan.volume)
    return (stops - stops[0]) @ effective


def test_what_machine_and_setup_can_do_is_explained_and_more_is_not():
    plan = plan_of("ppp", step=(0.03, 0.03, 0.03), blocks=12)

    def objections(*wrong):
        readings = readings_at_stops(plan, *wrong)
        return [expected(plan).objection(0, stop, went) for stop, went in enumerate(readings)]

    assert set(objections(TILT, SCALE)) == {""}
    assert set(objections(-TILT, -SCALE)) == {""}
    tilted = objections(2.5 * TILT)
    # The moves of a block bring the mirror back into the beam.
    assert any(tilted) and set(tilted[::3]) == {""}
    scaled = objections(0.0, 3.0 * SCALE)
    assert scaled[1] == "" and scaled[-1].startswith(
        "stop 36 of ppp XYZ forward, repeat 0 stands +1.8706 mm from where"
    )


def test_two_stops_are_never_taken_for_one_another_however_long_the_line():
    plan = plan_of("x", step=(0.001, 0.001, 0.001), blocks=1000)
    assert expected(plan).explained(0, 1000) == pytest.approx(0.35e-3)
    assert expected(plan).objection(0, 1000, 1.0005) != ""
