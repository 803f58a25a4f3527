"""What the bridge does not do, whoever asks: each fault of commands, sequencer and controller."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
import rclpy
from drivers_for_tests import bring_drivers
from patience import PATIENCE
from small_run import write_small_run
from test_managed_nodes import RUN, Bench, set_now

from stepdiag_ros import topics
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.configuration import load_plan
from stepdiag_ros.devices.cnc import CncState, PositionSample, StateChange, Traits
from stepdiag_ros.nodes.bridge import BridgeNode
from stepdiag_ros.nodes.links import message_class, quality
from stepdiag_ros.run.sequence import Answer

BAG = Path(__file__).parents[1] / "data" / "bags" / "schema_1.mcap"
LIMIT = 1.0
"""Real seconds of silence after which the machine is stopped here."""


class Mill:
    """A controller that goes where it is told at once, or as the test says; it counts its moves."""

    off = 0.0
    mute = False
    done = True
    traits = Traits(dead_man=0.1)
    moves = 0
    stopped = ""
    soft_limits = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))

    def __init__(self, _):
        self.state, self.place, self.events = CncState.READY, (0.0, 0.0, 0.0), []

    def start_move(self, time_ns, target, *_):
        Mill.moves += 1
        self.change(time_ns, CncState.MOVING)
        if Mill.done:
            x, y, z = target
            self.place = (x + Mill.off, y, z)
            self.change(time_ns, CncState.READY)

    def stop(self, time_ns, reason):
        Mill.stopped = reason
        self.change(time_ns, CncState.STOPPED, reason)

    def reset(self, time_ns):
        self.change(time_ns, CncState.READY)

    def poll(self, time_ns):
        events, self.events = self.events, []
        return events if Mill.mute else [*events, PositionSample(time_ns, self.place)]

    def close(self):
        pass

    def change(self, time_ns, state, reason=""):
        self.state = state
        self.events.append(StateChange(time_ns, state, self.place, reason))


def mill(*_):
    return Mill


@pytest.fixture
def bench(monkeypatch):
    bring_drivers(monkeypatch, ("cnc", "fake", "test_bridge_guard:mill"))
    for name, value in {"off": 0.0, "mute": False, "done": True, "moves": 0, "stopped": ""}.items():
        monkeypatch.setattr(Mill, name, value)
    monkeypatch.setattr(Mill, "traits", Traits(dead_man=0.1))
    made = []

    def make(*parameters):
        made.append(Bench(BridgeNode, f"silence_limit:={LIMIT}", *parameters))
        return made[-1]

    yield make
    for cell in made:
        cell.executor.shutdown()
    rclpy.try_shutdown()


def ready(cell):
    """Bring a bridge to where it takes commands of the run."""
    cell.await_state("active")
    cell.begin_run()
    assert cell.trigger("reset").success
    return cell


def answers(cell, number):
    heard = cell.heard[topics.COMMAND_STATUS]
    return [Answer(answer.status) for answer in heard if answer.command_id == number]


def reason(cell, number):
    heard = cell.heard[topics.COMMAND_STATUS]
    return next((a.reason for a in heard if a.command_id == number and a.reason), "")


def wait(cell, number, answer):
    cell.until(lambda: answer in answers(cell, number))


def wait_permitted(cell, number, condition):
    """Wait until something holds, and confirm a command as the sequencer does meanwhile."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, (cell.said(), Mill.stopped)
        rest(cell, 0.05)
        cell.permit(number)


def rest(cell, seconds):
    end = time.monotonic() + seconds
    cell.until(lambda: time.monotonic() > end)


def test_each_command_moves_the_machine_once_while_it_is_wanted(bench):
    cell = ready(bench())
    # Before anybody wants it, nothing moves, and in the end it is refused.
    cell.send(1, 0.01)
    wait(cell, 1, Answer.REJECTED)
    assert Mill.moves == 0 and "has not confirmed command 1" in reason(cell, 1)

    # A word that comes after the command counts as well; a repetition is no second command.
    cell.send(2, 0.01)
    rest(cell, 0.05)
    for _ in range(3):
        cell.permit(2)
        cell.send(2, 0.01)
    wait(cell, 2, Answer.IN_POSITION)
    rest(cell, 0.1)
    assert answers(cell, 2) == [Answer.ACCEPTED, Answer.MOVING, Answer.IN_POSITION]
    assert Mill.moves == 1
    cell.permit(1)
    cell.send(1, 0.02)
    rest(cell, 0.1)
    assert Mill.moves == 1, "executed twice"

    # Nobody wants the next one any more while it moves.
    Mill.done = False
    cell.permit(3)
    cell.send(3, 0.02)
    wait(cell, 3, Answer.MOVING)
    wait(cell, 3, Answer.STOPPED)
    assert Mill.stopped == f"the sequencer has not confirmed command 3 for {LIMIT:g} s"

    # Even when the controller is in order again, only an operator goes on.
    cell.node.device.reset(cell.node.now())
    cell.permit(4)
    cell.send(4, 0.01)
    wait(cell, 4, Answer.REJECTED)
    assert "an operator has to start or resume" in reason(cell, 4) and Mill.moves == 2


def test_a_bridge_that_was_started_again_repeats_nothing(bench):
    cell = bench()
    cell.await_state("active")
    cell.begin_run()
    # All of it may still be under way, with the word of a sequencer that does not know yet.
    for number in (7, 8):
        cell.permit(number)
        cell.send(number, 0.01)
    wait(cell, 8, Answer.REJECTED)
    assert Mill.moves == 0 and "was not released" in reason(cell, 8)
    assert cell.trigger("reset").success
    cell.permit(9)
    cell.send(8, 0.01)
    wait(cell, 8, Answer.REJECTED)
    rest(cell, LIMIT + 0.2)
    assert Mill.moves == 0


def test_a_recorded_run_moves_nothing(bench, tmp_path):
    """Every recorded message of a run, and even permits with it, beside a bridge that is ready."""
    cell = ready(bench("device:=simulated", "use_sim_time:=false"))
    speakers = {topics.RUN_DESCRIPTION: cell.descriptions, topics.MACHINE_COMMAND: cell.commands}
    names = {topics.absolute(topic): topic for topic in speakers}
    with open_bag(write_small_run(tmp_path / "run.mcap")) as bag:
        records = list(bag.records(topics=list(names)))
        for _ in range(3):
            for record in records:
                speakers[names[record.topic]].publish(record.data)
                rest(cell, 0.02)
                if names[record.topic] is topics.RUN_DESCRIPTION:
                    cell.until(lambda: cell.node.run_id not in ("", RUN))
                    # As if an operator resumed in the middle of it.
                    assert cell.trigger("reset").success
                if names[record.topic] is topics.MACHINE_COMMAND:
                    sent = bag.types.decode(topics.MACHINE_COMMAND.type_name, record.data)
                    permit = {"run_id": sent.run_id, "command_id": sent.command_id}
                    cell.permits.publish(cell.permits.msg_type(**permit))
    rest(cell, LIMIT + 0.3)
    said = cell.heard[topics.COMMAND_STATUS]
    assert said and {answer.status for answer in said} == {int(Answer.REJECTED)}
    assert any("it is late, recorded, or clocks differ" in answer.reason for answer in said)
    assert {tuple(message.position) for message in cell.heard[topics.JOINT_STATES]} == {
        (0.0, 0.0, 0.0)
    }


def test_no_replay_begins_beside_a_live_bridge(bench):
    cell = ready(bench())
    command = [sys.executable, "-m", "stepdiag_ros.cli", "replay", str(BAG)]
    replay = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    commanding = set()
    name = topics.absolute(topics.MACHINE_COMMAND)

    def ended():
        commanding.add(cell.node.count_publishers(name))
        return replay.poll() is not None

    cell.until(ended)
    # A second publisher of commands would stop the machine, although nothing is replayed.
    assert replay.returncode == 1 and commanding == {1}
    assert "a cnc_bridge node runs already: end it" in replay.stderr.read()


def test_a_real_machine_follows_no_simulated_time(bench):
    cell = bench("use_sim_time:=true")
    clock = cell.speaker(topics.CLOCK)
    message = clock.msg_type()
    message.clock.sec = 1
    for _ in range(20):
        clock.publish(message)
        rest(cell, 0.02)
    cell.until(lambda: "a replay could drive a real machine" in cell.said()[1])
    assert cell.node.device is None


def test_moves_that_plan_and_machine_do_not_allow_never_reach_the_controller(bench):
    cell = ready(bench())
    wrong = {
        1: {"target": [0.31, 0.0, 0.0]},
        2: {"target": [float("nan"), 0.0, 0.0]},
        3: {"target": [0.01, 0.01, 0.0]},
        4: {"feed": 0.034},
        5: {"feed": float("nan")},
        6: {"axis": "XY", "target": [0.01, 0.01, 0.0]},
        7: {"purpose": 0, "stop": 1, "target": [0.02, 0.0, 0.0]},
        8: {"line_index": 99},
    }
    for number, fields in wrong.items():
        cell.permit(number)
        cell.send(number, 0.01, **fields)
        wait(cell, number, Answer.REJECTED)
    assert Mill.moves == 0
    said = [reason(cell, number) for number in wrong]
    assert "outside the plan's box" in said[0] and "above the feed of the plan" in said[3]


def test_a_controller_that_says_done_too_early_or_falls_silent_is_stopped(bench):
    cell = ready(bench())
    Mill.off = 4e-6
    cell.permit(1)
    cell.send(1, 0.01)
    wait_permitted(cell, 1, lambda: Answer.FAULT in answers(cell, 1))
    assert "the move is done, but X is 4 µm off its target" in reason(cell, 1)
    assert Answer.IN_POSITION not in answers(cell, 1) and "4 µm" in Mill.stopped

    Mill.off, Mill.done = 0.0, False
    assert cell.trigger("reset").success
    cell.permit(2)
    cell.send(2, 0.02)
    wait(cell, 2, Answer.MOVING)
    Mill.mute = True
    wait_permitted(cell, 2, lambda: Mill.stopped.startswith("the axes move"))
    assert Mill.stopped == f"the axes move, but no actual position has come for {LIMIT:g} s"


def test_a_controller_that_is_too_brisk_is_not_used(bench, monkeypatch):
    monkeypatch.setattr(Mill, "traits", Traits(acceleration=(1.0, 9.0, 1.0)))
    cell = bench()
    cell.until(lambda: "accelerates Y with up to 9 m/s²" in cell.said()[1])
    assert cell.node.device is None and Mill.moves == 0


def test_another_run_that_is_announced_in_a_move_stops_it(bench):
    cell = ready(bench())
    Mill.done = False
    cell.permit(1)
    cell.send(1, 0.01)
    wait(cell, 1, Answer.MOVING)
    description = cell.descriptions.msg_type(run_id="another", schema_version=1)
    description.plan = load_plan("quick")[1]
    set_now(description, cell.node)
    cell.descriptions.publish(description)
    wait(cell, 1, Answer.STOPPED)
    assert "another run begins" in Mill.stopped


@pytest.fixture
def rogue():
    """Return a function that makes a node with publishers as the sequencer has them."""
    made = []

    def make(cell, name="rogue"):
        node = rclpy.create_node(name)
        cell.executor.add_node(node)
        made.append(node)
        return node, {
            topic: node.create_publisher(message_class(topic), topic.name, quality(topic))
            for topic in (topics.RUN_DESCRIPTION, *topics.COMMANDING)
        }

    yield make
    for node in made:
        node.destroy_node()


def findings(cell, task):
    """Return the last level and text of one subject on /diagnostics."""
    for array in reversed(cell.heard[topics.DIAGNOSTICS]):
        for status in array.status:
            if status.name.endswith(f": {task}"):
                return ord(status.level), status.message
    return None, ""


@pytest.mark.parametrize("name", ["rogue", "manager"])
def test_whoever_publishes_commands_beside_the_sequencer_stops_the_machine(bench, rogue, name):
    cell = ready(bench())
    Mill.done = False
    cell.permit(1)
    cell.send(1, 0.01)
    wait(cell, 1, Answer.MOVING)
    alone = (0, "commands are taken from node /manager alone")
    wait_permitted(cell, 1, lambda: findings(cell, "sequencer") == alone)
    # It does not even say anything, and may take the sequencer's own name.
    node, _ = rogue(cell, name)
    wait(cell, 1, Answer.STOPPED)
    told = "node /" + name + " publishes machine/"
    assert Mill.stopped.startswith(told) or "publisher without a node" in Mill.stopped
    assert Mill.stopped.endswith("beside node /manager, from which this run takes its commands:"
                                 " end it, then resume")  # fmt: skip
    cell.until(lambda: findings(cell, "sequencer")[0] == 2)
    cell.until(lambda: told in findings(cell, "sequencer")[1])
    refused = cell.trigger("reset")
    assert not refused.success and told in refused.message
    cell.permit(2)
    cell.send(2, 0.01)
    wait(cell, 2, Answer.REJECTED)
    assert told in reason(cell, 2) and Mill.moves == 1
    # Once it has gone an operator resumes, and nothing goes on before.
    for publisher in list(node.publishers):
        node.destroy_publisher(publisher)
    cell.until(lambda: findings(cell, "sequencer")[0] == 0)
    cell.permit(3)
    cell.send(3, 0.01)
    wait(cell, 3, Answer.REJECTED)
    assert told in reason(cell, 3), "why it was not released"
    assert cell.trigger("reset").success
    Mill.done = True
    cell.permit(4)
    cell.send(4, 0.01)
    wait(cell, 4, Answer.IN_POSITION)
    assert Mill.moves == 2


def test_a_stranger_cannot_command_a_run_of_his_own_beside_the_sequencer(bench, rogue):
    cell = bench()
    cell.await_state("active")
    _, speakers = rogue(cell)
    description = cell.descriptions.msg_type(run_id="evil", schema_version=1)
    description.plan = load_plan("quick")[1]
    set_now(description, cell.node)
    cell.until(lambda: speakers[topics.RUN_DESCRIPTION].get_subscription_count() == 1)
    speakers[topics.RUN_DESCRIPTION].publish(description)
    cell.until(lambda: cell.node.run_id == "evil")
    refused = cell.trigger("reset")
    assert not refused.success
    assert "/manager" in refused.message and "/rogue" in refused.message
    cell.commands, cell.permits = (speakers[topic] for topic in topics.COMMANDING)
    for number in range(1, 6):
        cell.permits.publish(cell.permits.msg_type(run_id="evil", command_id=number))
        cell.send(number, 0.01, run_id="evil")
        wait(cell, number, Answer.REJECTED)
    rest(cell, LIMIT + 0.2)
    assert Mill.moves == 0


def test_a_command_that_comes_at_once_with_its_stranger_is_not_executed(bench, rogue):
    """Its publisher is in the graph before its first message is heard."""
    cell = ready(bench())
    for number in range(1, 11):
        node, speakers = rogue(cell)
        own = cell.commands, cell.permits
        cell.commands, cell.permits = (speakers[topic] for topic in topics.COMMANDING)
        cell.until(lambda: cell.permits.get_subscription_count() == 1)
        for _ in range(3):
            cell.permit(number)
            cell.send(number, 0.01)
        wait(cell, number, Answer.REJECTED)
        for publisher in list(node.publishers):
            node.destroy_publisher(publisher)
        cell.commands, cell.permits = own
        cell.until(lambda: cell.trigger("reset").success)
    assert Mill.moves == 0
