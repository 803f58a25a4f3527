"""A line measured on the fly gives what stops give, within its uncertainty, or a reason."""

from dataclasses import replace

import numpy as np
import pytest
from moving_machine import FAST, MovingMachine, Worst, differences, judged

from stepdiag_ros.metrology.on_the_fly.evaluate import evaluate_pass
from stepdiag_ros.metrology.on_the_fly.record import PassFault
from stepdiag_ros.metrology.plan import FORWARD, LINEAR, Line


@pytest.mark.parametrize(
    ("machines", "low", "high"),
    [pytest.param(8, 0.88, 0.99, id="few"), pytest.param(100, 0.93, 0.97, id="many")],
)
def test_intervals_cover_the_true_values(machines, low, high):
    nodes, e_n, delays, curves = judged(machines)
    assert low <= np.mean(nodes <= 2.0) <= high
    assert low <= np.mean(curves <= 2.0) <= high
    assert np.mean(e_n <= 1.0) >= 0.95
    assert np.mean(delays <= 2.0) >= low - 0.08


def test_delay_and_vibration_are_found():
    found = evaluate_pass(MovingMachine(3).record())
    assert {axis.axis for axis in found.delays} == set("XYZ")
    for axis, true in zip(found.delays, (3.1e-3, 2.95e-3, 3.18e-3), strict=True):
        assert abs(axis.delay - true) < 10e-6
        assert 0.1e-6 < axis.standard_uncertainty < 5e-6
    assert found.vibration.frequency == pytest.approx(40.0, abs=0.3)
    assert found.vibration.amplitude == pytest.approx(0.3e-6, rel=0.1)
    assert 0.0 < found.common < np.max(found.standard_uncertainty)


def test_no_vibration_is_found_where_there_is_none():
    found = evaluate_pass(MovingMachine(3, worst=replace(FAST, vibration=0.0)).record())
    assert not found.vibration.found


def test_a_linear_axis_is_measured_on_the_fly():
    machine = MovingMachine(4, Line(LINEAR, "x", "", 0, FORWARD))
    found = evaluate_pass(machine.record())
    moved, u = differences(found.displacement, found.covariance)
    true = machine.true()
    assert np.max(np.abs(moved - (true[1:] - true[0])) / u) < 4.0
    assert [axis.axis for axis in found.delays] == ["X"]


def test_a_slow_stream_of_positions_serves_too():
    machine = MovingMachine(1, worst=replace(FAST, position_rate=200.0))
    _nothing_is_wrong(machine, evaluate_pass(machine.record()))


def _nothing_is_wrong(machine, found):
    """Assert that a node has its true value or a reason, and never another value."""
    has = np.isfinite(found.displacement)
    assert [not reason for reason in found.reasons] == has.tolist()
    if has.sum() > 1:
        true = machine.true()[has]
        moved, u = differences(found.displacement[has], found.covariance[np.ix_(has, has)])
        assert np.max(np.abs(moved - (true[1:] - true[0])) / u) < 4.5


def _faulty(machine, fault, missing, found):
    assert fault in [finding.fault for finding in found.findings]
    assert np.flatnonzero(np.isnan(found.displacement)).tolist() == list(missing)
    _nothing_is_wrong(machine, found)


def test_a_lost_beam_ends_the_pass():
    machine = MovingMachine(1, worst=FAST)
    record = machine.record()
    record.statuses[2000:] = 2
    record.displacements[2000:2050] = np.nan
    _faulty(machine, PassFault.BEAM_LOST, range(7, 19), evaluate_pass(record))


@pytest.mark.parametrize(("first", "last", "missing"), [(2100, 2130, []), (2080, 2200, [7])])
def test_a_gap_in_the_positions_takes_the_move_that_it_hides(first, last, missing):
    machine = MovingMachine(1, worst=FAST)
    record = machine.record()
    kept = np.ones(len(record.position_times), dtype=bool)
    kept[first:last] = False
    record = replace(
        record, position_times=record.position_times[kept], positions=record.positions[kept]
    )
    found = evaluate_pass(record)
    if missing:
        assert PassFault.POSITION_GAP in [finding.fault for finding in found.findings]
    assert set(missing) <= set(np.flatnonzero(np.isnan(found.displacement)).tolist())
    assert np.count_nonzero(np.isnan(found.displacement)) <= 2 * len(missing)
    _nothing_is_wrong(machine, found)


@pytest.mark.parametrize("first", range(2000, 2300, 50))
def test_no_gap_gives_a_wrong_number(first):
    machine = MovingMachine(1, worst=FAST)
    record = machine.record()
    kept = np.ones(len(record.position_times), dtype=bool)
    kept[first : first + 40] = False
    found = evaluate_pass(
        replace(
            record, position_times=record.position_times[kept], positions=record.positions[kept]
        )
    )
    _nothing_is_wrong(machine, found)


def test_missing_readings_take_their_move():
    machine = MovingMachine(1, worst=FAST)
    record = machine.record()
    kept = np.ones(len(record.reading_times), dtype=bool)
    kept[2200:2203] = False
    fields = ("reading_times", "sequences", "displacements", "statuses")
    record = replace(record, **{name: getattr(record, name)[kept] for name in fields})
    _faulty(machine, PassFault.READINGS_MISSING, [8], evaluate_pass(record))


@pytest.mark.parametrize("step_ms", [0.2, 0.5, 2.0, 20.0, 200.0])
@pytest.mark.parametrize("stream", ["position_times", "reading_times"])
def test_a_step_of_a_clock_refuses_the_pass(stream, step_ms):
    machine = MovingMachine(2, worst=FAST)
    record = machine.record()
    times = getattr(record, stream).copy()
    times[len(times) // 2 :] += round(step_ms * 1e6)
    found = evaluate_pass(replace(record, **{stream: times}))
    assert np.all(np.isnan(found.displacement))
    assert found.findings[-1].fault in (PassFault.CLOCK_STEP, PassFault.NOT_JOINED)


def test_a_clock_that_steps_back_refuses_the_pass():
    record = MovingMachine(2, worst=FAST).record()
    record.position_times[2000:] -= 50_000_000
    found = evaluate_pass(record)
    assert np.all(np.isnan(found.displacement))
    assert found.findings[-1].fault is PassFault.CLOCK_STEP


def test_a_blended_corner_is_found():
    machine = MovingMachine(1, worst=FAST, blend={4})
    _faulty(machine, PassFault.BLENDED_CORNER, [4, 5], evaluate_pass(machine.record()))


def test_a_controller_that_blends_all_corners_is_refused():
    found = evaluate_pass(MovingMachine(1, worst=FAST, blend=set(range(1, 18))).record())
    assert np.all(np.isnan(found.displacement))
    assert found.findings[-1].fault is PassFault.BLENDED_CORNER


@pytest.mark.parametrize("worst", [Worst(), FAST], ids=["slow", "fast"])
def test_a_turned_override_takes_its_move(worst):
    machine = MovingMachine(1, worst=worst, override={5: 0.7})
    _faulty(machine, PassFault.FEED_CHANGED, [5], evaluate_pass(machine.record()))


def test_without_enough_positions_the_pass_is_refused():
    found = evaluate_pass(MovingMachine(1, worst=replace(FAST, position_rate=20.0)).record())
    assert np.all(np.isnan(found.displacement))
    assert found.findings[-1].fault is PassFault.NO_POSITIONS
