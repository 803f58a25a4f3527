"""A small ISO 230-6 test on the node graph: axes that move at once, and who may move them."""

import numpy as np
import pytest

from stepdiag_ros import topics
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.configuration import load_cell
from stepdiag_ros.messages.conversion import PURPOSE_POSITION, from_stop_command
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.measurement import StopCommand
from stepdiag_ros.metrology.plan import DIAGONAL
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.nodes.links import message_class, quality
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


def bridge_of(cell):
    return next(p for p in cell.operator.watch.peers.values() if p.role == "cnc_bridge")


def meddle(cell):
    """Command a move beside the sequencer: nothing moves, and the run is held until that ends.

    The bridge reports the other sender after it has stopped the machine, and its end later than the
    sequencer sees it: who resumes before would be stopped again.
    """
    commands = cell.operator.create_publisher(
        message_class(topics.MACHINE_COMMAND),
        topics.MACHINE_COMMAND.name,
        quality(topics.MACHINE_COMMAND),
    )
    cell.wait(lambda: commands.get_subscription_count() >= 1, "the bridge listens")
    # No number of a command that the sequencer has sent or will send.
    cell.stands_still_after(cell.operator.state)
    x, y, z = before = tuple(cell.positions[-1].position)
    stop = StopCommand(1000, 0, 1, "", 0, "X", (x + 0.001, y, z), 0)
    now = cell.operator.now()
    commands.publish(from_stop_command(stop, cell.operator.started_run, now, 0.1, PURPOSE_POSITION))
    cell.wait_for_state(State.FAULT)
    assert "beside node /sequencer" in cell.operator.state.text
    cell.stands_still_after(cell.operator.state)
    assert tuple(cell.positions[-1].position) == pytest.approx(before, abs=1e-6)
    assert not any(
        status.command_id == 1000 and status.status != Answer.REJECTED for status in cell.statuses
    )
    # Discovery may bring the publisher before the node that it belongs to.
    name = cell.operator.get_name()
    cell.wait(lambda: name in bridge_of(cell).text, "the bridge names the other sender")
    assert bridge_of(cell).faulty
    cell.operator.destroy_publisher(commands)
    cell.wait(lambda: not bridge_of(cell).faulty, "the bridge has seen its end")


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "small.yaml"
    path.write_text(PLAN)
    return path


def test_diagonals_on_the_node_graph(make_cell, plan_file):
    with make_cell(plan=str(plan_file), tick=0.004) as cell:
        cell.start()
        cell.wait(lambda: len(cell.stops) >= 1, "a stop")
        cell.operator.call("sequencer/pause")
        cell.wait_for_state(State.PAUSED)
        meddle(cell)
        cell.resume()
        cell.wait_for_state(State.FINISHED)
        cell.wait(cell.bag_is_closed, "the bag is closed")
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

    # As they were recorded: this process may be too busy to hear them all.
    with BagReader(bag) as reader:
        recorded = reader.messages(topics={topics.absolute(topics.JOINT_STATES)})
        positions = [message for _, message in recorded]
    step = np.array(run.plan.volume.step)
    stops = {stop.command.command_id: stop for stop in run.stops}
    judged = []
    for stop in run.stops:
        before = stops.get(stop.command.command_id - 1)
        if before is None or stop.line.kind != DIAGONAL:
            continue
        # Between two stops of a diagonal the machine was always on it.
        direction = beam_direction(stop.line.name, step)
        begin, end = before.command.time, stop.in_position_time
        on_way = [
            np.array(message.position)
            for message in positions
            if begin < to_nanoseconds(message.header.stamp) < end
        ]
        judged.append(len(on_way))
        for place in on_way:
            beside = np.cross(place - np.array(stop.command.target), direction)
            assert np.linalg.norm(beside) < 5e-6
    # On a busy computer moves end before a position is told, but not all of them.
    assert max(judged) >= 3
