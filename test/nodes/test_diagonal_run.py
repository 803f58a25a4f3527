"""A small ISO 230-6 test on the node graph: axes that move at once, and when they may not."""

import numpy as np
import pytest

from stepdiag_ros import topics
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.configuration import load_cell
from stepdiag_ros.conversion import PURPOSE_POSITION, from_stop_command
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.measurement import StopCommand
from stepdiag_ros.metrology.plan import DIAGONAL
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.run.sequence import Answer, State

PLAN = """
name: small ISO 230-6
origin_m: [0.002, 0.002, 0.002]
step_m: [0.02, 0.015, 0.01]
blocks: 2
directions: [forward, backward]
overrun_m: 0.002
feed_m_per_s: 0.1
pause_for_setup: false
lines:
  - {kind: linear, names: [x], directions: [forward]}
  - {kind: diagonal, names: [npp]}
  - {kind: diagonal, names: [np0], offset_m: [0.0, 0.0, 0.02]}
sampling: {dwell_s: 0.1, settle_s: 0.1, window_s: 0.1}
"""


def refused(cell, line_index, axes, target):
    """Send a move of one's own and return the bridge's refusal; the machine must not move."""
    # No number of a command that the sequencer has sent or will send.
    number = 1000 + len(cell.statuses)
    stop = StopCommand(number, line_index, 1, "", 0, axes, target, 0)
    run, now = cell.operator.started_run, cell.operator.now()
    command = from_stop_command(stop, run, now, 0.1, PURPOSE_POSITION)
    before = tuple(cell.machine.position)
    cell.commands.publish(command)
    answers = []

    def answered():
        answers[:] = [status for status in cell.statuses if status.command_id == number]
        return bool(answers)

    cell.wait(answered, 20.0, "the bridge answers")
    cell.operator.spin_until(lambda: False, 0.3)
    assert tuple(cell.machine.position) == pytest.approx(before, abs=1e-6)
    assert [Answer(status.status) for status in answers] == [Answer.REJECTED]
    return answers[0].reason


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "small.yaml"
    path.write_text(PLAN)
    return path


def test_diagonals_on_the_node_graph(make_cell, plan_file):
    with make_cell(plan=str(plan_file), factor=10.0) as cell:
        cell.commands = cell.operator.announce(topics.MACHINE_COMMAND)
        cell.start()
        cell.wait(lambda: len(cell.stops) >= 1, 20.0, "a stop")
        cell.operator.call("sequencer/pause")
        cell.wait_for_state(State.PAUSED, 30.0)
        x, y, z = cell.machine.position
        reason = refused(cell, 0, "XY", (x + 0.01, y + 0.01, z))
        assert "X and Y at once; on line 'x forward, repeat 0' only one axis" in reason
        assert "begins at" in refused(cell, 1, "XYZ", (0.022, 0.017, 0.012))
        cell.operator.call("sequencer/resume")
        cell.wait_for_state(State.FINISHED, 120.0)
        cell.wait(cell.bag_is_closed, 30.0, "the bag is closed")
        (bag,) = cell.folder.glob("*.mcap")

    run = load_run(bag)
    assert [str(line.line) for line in run.lines] == [str(line) for line in run.plan.lines]
    # The readings are those of the cell at the targets, but for noise and what air adds.
    truth = simulate(run.plan, load_cell("demo")[0])
    for line, true in zip(run.lines, truth.lines, strict=True):
        assert line.line == true.line and line.complete
        assert line.displacement == pytest.approx(true.displacement, abs=0.5e-6)
    again = assemble(run.plan, run.start_time, run.commands, run.arrivals, run.readings())
    blocks = [event for event in again if type(event) is type(run.blocks[0])]
    assert blocks == list(run.blocks)
    assert {block.axis for block in blocks if block.line.kind == DIAGONAL} == {"XYZ", "XY"}

    step = np.array(run.plan.volume.step)
    stops = {stop.command.command_id: stop for stop in run.stops}
    for stop in run.stops:
        before = stops.get(stop.command.command_id - 1)
        if before is None or stop.line.kind != DIAGONAL:
            continue
        # Between two stops of a diagonal the machine was always on it.
        direction = beam_direction(stop.line.name, step)
        begin, end = before.command.time, stop.in_position_time
        on_way = [
            np.array(message.position)
            for message in cell.positions
            if begin < message.header.stamp.sec * 10**9 + message.header.stamp.nanosec < end
        ]
        assert len(on_way) >= 3
        for place in on_way:
            beside = np.cross(place - np.array(stop.command.target), direction)
            assert np.linalg.norm(beside) < 5e-6
