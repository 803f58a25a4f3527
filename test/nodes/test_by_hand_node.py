"""The node ``by_hand``: a run without bridge or sequencer is followed and recorded."""

import json
import time
from dataclasses import replace

import numpy as np
import pytest
import rclpy
from patience import PATIENCE
from program_run import Instrument, run_program
from ros_processes import ros  # noqa: F401

from stepdiag_ros import cli, topics
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.configuration import load_cell, load_plan
from stepdiag_ros.messages.conversion import from_reading
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.planning.moves import moves_of
from stepdiag_ros.planning.plan_text import plan_text
from stepdiag_ros.processes.node_process import NodeProcess, Processes
from stepdiag_ros.run.sequence import State


@pytest.fixture
def laser(ros):  # noqa: F811
    """A node in the place of the interferometer, which also calls services."""
    from std_srvs.srv import Trigger

    from stepdiag_ros.nodes.base import StepdiagNode

    class Laser(StepdiagNode):
        role = "interferometer"

        def __init__(self):
            super().__init__("interferometer")
            self.readings = self.announce(topics.READING)
            self.state, self.texts = None, set()
            self.listen(topics.RUN_STATE, self.hear)

        def hear(self, message):
            self.state = message
            self.texts.add(message.text)

        def until(self, true):
            end = time.monotonic() + PATIENCE
            while not true():
                assert time.monotonic() < end, self.state
                ros.spin_once(self, timeout_sec=0.02)

        def ask(self, name):
            client = self.create_client(Trigger, f"by_hand/{name}")
            self.until(client.service_is_ready)
            future = client.call_async(Trigger.Request())
            self.until(future.done)
            return future.result()

    made = Laser()
    yield made
    made.destroy_node()


def test_a_run_is_followed_recorded_and_assembled_the_same_again(laser, tmp_path):
    plan = load_plan("quick")[0]
    plan = replace(plan, sampling=replace(plan.sampling, dwell=1.0), lines=plan.lines[:1])
    (tmp_path / "plan.yaml").write_text(plan_text(plan))
    moves = moves_of(plan)
    seen = run_program(
        plan,
        moves,
        load_cell("demo")[0],
        2.0,
        Instrument(rate=50.0, seed=6, work=5.0, first_time=time.time_ns()),
    )
    nodes = [
        # A busy computer may keep this laser from speaking for a while.
        NodeProcess("assembler", {"reading_timeout": PATIENCE}),
        NodeProcess("solver"),
        NodeProcess("recorder", {"folder": tmp_path, "reading_timeout": PATIENCE}),
        NodeProcess("by_hand", {"plan": tmp_path / "plan.yaml"}),
    ]
    with Processes(nodes, tmp_path / "logs") as processes:
        laser.until(lambda: processes.ended() or laser.state is not None)
        assert not processes.ended()
        refused = laser.ask("resume")
        assert not refused.success and "no run" in refused.message
        end = time.monotonic() + PATIENCE
        while not (answer := laser.ask("start")).success:
            assert time.monotonic() < end, answer.message
        laser.until(lambda: laser.state.state == State.WAITING_FOR_SETUP)
        assert laser.state.text.startswith("by hand: align laser and mirror for x")
        # The laser reads while it is aligned, and no run goes on without readings.
        ready = seen.arrivals[1] + 9_000_000_000
        readings = iter(seen.readings)
        while not (answer := laser.ask("resume")).success:
            assert time.monotonic() < end + PATIENCE, answer.message
            laser.readings.publish(from_reading(next(readings), "laser"))
        for reading in readings:
            if reading.time >= ready:
                laser.readings.publish(from_reading(reading, "laser"))
                rclpy.spin_once(laser, timeout_sec=0.005)
        laser.until(lambda: laser.state.state == State.FINISHED)
        assert laser.state.text == "all lines are measured by hand"
        laser.until(lambda: any(tmp_path.glob("*.mcap")))
        laser.until(lambda: "closed" in (tmp_path / "logs" / "recorder.log").read_text())
    assert "by hand: stop 2 of x forward, repeat 0 found" in laser.texts
    (bag,) = tmp_path.glob("*.mcap")
    run = load_run(bag)
    (line,) = run.lines
    assert line.complete and [command.stop for command in run.commands] == [0, 1, 2, 3]
    assert line.displacement == pytest.approx([0.0, 0.01, 0.02, 0.03], abs=1e-5)
    again = assemble(run.plan, run.start_time, run.commands, run.arrivals, run.readings())
    (same,) = (event for event in again if isinstance(event, MeasuredLine))
    assert np.array_equal(line.displacement, same.displacement)
    assert np.array_equal(line.time, same.time)


def test_a_replay_of_a_run_found_in_a_file_gives_the_same_bytes(tmp_path, capsys):
    plan = load_plan("quick")[0]
    sampling = replace(plan.sampling, dwell=2.0, window=1.0, settle=0.3)
    plan = replace(plan, sampling=sampling, lines=plan.lines[:1])
    (tmp_path / "plan.yaml").write_text(plan_text(plan))
    instrument = Instrument(rate=10.0, seed=6, work=5.0)
    seen = run_program(plan, moves_of(plan), load_cell("demo")[0], 2.0, instrument)
    rows = [f"{one.time * 1e-6}\t{one.compensated_displacement * 1e3}\n" for one in seen.readings]
    laser = tmp_path / "laser.txt"
    laser.write_text("Time (ms)\tDistance (mm)\n" + "".join(rows))
    given = ["--mapping", "readings_in_time", "--plan", str(tmp_path / "plan.yaml")]
    bag = tmp_path / "laser_by_hand.mcap"
    assert cli.main(["by-hand", str(laser), *given, "--output", str(bag)]) == 0
    capsys.readouterr()
    assert cli.main(["replay", str(bag), "--rate", "0", "--check", "--json"]) == 0
    same = json.loads(capsys.readouterr().out)["same"]
    assert set(same) == {f"/measurement/{name}" for name in ("stop", "block", "line")}
    assert all(same.values())


def test_nothing_is_measured_by_hand_where_a_bridge_is(laser, tmp_path):
    nodes = [NodeProcess("by_hand"), NodeProcess("bridge")]
    with Processes(nodes, tmp_path):
        end = time.monotonic() + PATIENCE
        while "a cnc_bridge node is there" not in (answer := laser.ask("start")).message:
            assert not answer.success
            assert time.monotonic() < end, answer.message
