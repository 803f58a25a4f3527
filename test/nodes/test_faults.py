"""Any node killed in a run: the others say so, the machine stops, the run can go on."""

import itertools
import random
import re
import time

from running_cell import TWO_LINES

from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.recover import recover
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.configuration import load_plan
from stepdiag_ros.run.sequence import State

LOST = 10.0
"""Seconds of silence after which a node counts as lost in these cells: twice the default, so that
the others are heard on a busy computer."""
ROLES = {
    "interferometer": "interferometer",
    "bridge": "cnc_bridge",
    "assembler": "assembler",
    "solver": "solver",
    "recorder": "recorder",
    "weather": "weather",
}


def bags(cell):
    return sorted(cell.folder.glob("*.mcap"))


def test_a_killed_node_stops_the_run_which_can_be_resumed(make_cell, tmp_path):
    """One after another, all in one run, which is measured to its end."""
    plan = tmp_path / "often.yaml"
    text = load_plan("quick")[1]
    # Until the loss of a node is noticed, the run goes on by up to 80 s of its own time.
    plan.write_text(text.replace("repeats: 1", "repeats: 4"))
    assert load_plan(str(plan))[0].stop_count > load_plan("quick")[0].stop_count
    with make_cell(plan=str(plan), factor=8.0, heartbeat_timeout=LOST) as cell:
        cell.start()
        cell.wait(lambda: len(cell.stops) >= 5, "five stops")
        for name in ROLES:
            count = len(cell.stops)
            cell.wait(lambda: len(cell.stops) > count + 1, "stops go on")  # noqa: B023
            kill_in_the_run(cell, name)
            cell.restart(name)
            cell.resume()
        cell.wait_for_state(State.FINISHED)
        cell.wait(cell.bag_is_closed, "the bag is closed")
        finished_lines = {message.line_index for message in cell.lines}
        assert finished_lines == set(range(cell.operator.state.line_count))

    of_the_killed_recorder, last = bags(cell)
    recover(of_the_killed_recorder, tmp_path / "whole.mcap")
    for bag in (tmp_path / "whole.mcap", last):
        with BagReader(bag) as reader:
            assert sum(1 for _ in reader.records()) > 100


def kill_in_the_run(cell, name) -> None:
    """Kill a node, and assert that the run is stopped and that all others say why."""
    killed = time.monotonic()
    cell.kill(name)
    cell.wait_for_state(State.FAULT)
    # A command that the bridge was just sent shows it as soon as its silence does. After how long
    # a silent node is lost, test_supervision asks on a clock of its own.
    said = rf"{name} (?:is silent|has not answered a command) for [0-9.]+ s"
    assert len(re.findall(said, cell.operator.state.text)) == 1
    others = set(ROLES.values()) - {ROLES[name]}

    def all_said() -> bool:
        return all(
            any(
                f"{ROLES[name]} node" in text and "silent" in text
                for text in cell.said_since(role, killed)
            )
            for role in others
        )

    cell.wait(all_said, f"all of {others} say that {name} is gone")
    if name != "bridge":
        cell.stands_still_after(cell.operator.state)


def _healthy_roles(cell) -> set[str]:
    watch = cell.operator.watch
    return {
        peer.role
        for name, peer in watch.peers.items()
        if name not in watch.lost and not peer.faulty
    }


def test_a_killed_clock_stops_the_run(make_cell):
    with make_cell(plan="demo", heartbeat_timeout=LOST) as cell:
        cell.start()
        cell.wait(lambda: len(cell.stops) >= 5, "five stops")
        cell.kill("clock")
        cell.wait_for_state(State.FAULT)
        assert "clock" in cell.operator.state.text
        cell.operator.call("sequencer/abort")
        cell.wait(cell.bag_is_closed, "the bag is closed")
    (bag,) = bags(cell)
    with BagReader(bag) as reader:
        assert sum(1 for _ in reader.records()) > 100


def test_a_killed_sequencer_stops_the_machine_and_a_new_run_can_be_started(make_cell):
    with make_cell(plan="demo", heartbeat_timeout=LOST) as cell:
        cell.start()
        cell.wait(lambda: len(cell.stops) >= 5, "five stops")
        cell.kill("sequencer")
        cell.wait(
            lambda: (
                cell.machine.state == cell.machine.STATE_STOPPED
                and "sequencer" in cell.machine.reason
            ),
            "the bridge has stopped the machine",
        )
        cell.stands_still_after(cell.machine)
        cell.restart("sequencer")
        cell.wait(lambda: "sequencer" in _healthy_roles(cell), "the sequencer is back")
        cell.operator.state = None
        run_id = cell.start(TWO_LINES)
        cell.wait_for_state(State.FINISHED)
        cell.wait(cell.bag_is_closed, "the bag is closed")
    assert len(bags(cell)) == 2
    for bag in bags(cell):
        with BagReader(bag) as reader:
            assert reader.header.run_id in bag.name
    assert any(run_id in bag.name for bag in bags(cell))


def test_a_recorder_killed_at_20_random_moments_loses_the_block_in_progress_at_most(
    make_cell, tmp_path
):
    chance = random.Random(20261121)
    with make_cell(plan="demo", heartbeat_timeout=LOST) as cell:
        cell.start()
        known: list[int] = []
        for number in range(20):
            count = len(cell.stops)
            cell.wait(lambda: len(cell.stops) > count + 1, "stops go on")  # noqa: B023
            cell.operator.spin_until(lambda: False, chance.uniform(0.0, 0.5))
            cell.kill("recorder")
            known.append(cell.stops[-1].command_id)
            cell.wait_for_state(State.FAULT)
            cell.restart("recorder")
            cell.resume()
            assert len(bags(cell)) >= number + 1
        count = len(cell.stops)
        cell.wait(lambda: len(cell.stops) > count, "stops go on")
        cell.operator.call("sequencer/abort")
        cell.wait(cell.bag_is_closed, "the last bag is closed")

    parts = sorted(bags(cell), key=lambda bag: bag.stat().st_mtime)
    assert len(parts) == 21
    for number, (part, last_known) in enumerate(zip(parts[:20], known, strict=True)):
        whole = tmp_path / f"{number}.mcap"
        recover(part, whole)
        run = load_run(whole)
        stops = [stop.command.command_id for stop in run.stops]
        # The stop that was published last may not have reached the recorder any more.
        assert max(stops) >= last_known - 1, part.name
        # Whoever has just joined a stream may miss some of it; no stop is made before it has come.
        begun = min(stop.window_start for stop in run.stops)
        ended = max(stop.window_end for stop in run.stops)
        readings = [reading for reading in run.readings() if begun <= reading.time < ended]
        lost = {
            1e-9 * (a.time - begun): b.sequence - a.sequence - 1
            for a, b in itertools.pairwise(readings)
            if b.sequence != a.sequence + 1
        }
        assert not lost, f"{part.name}: s after the first window → readings lost"
    assert load_run(parts[20]).stops
