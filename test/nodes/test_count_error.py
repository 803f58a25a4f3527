"""A count that jumps while the axes stand loses the zero; a node that was exchanged, the run."""

import pytest
import rclpy
from drivers_for_tests import bring_drivers
from fake_devices import FakeDevice
from test_managed_nodes import RUN, Bench, set_now

from stepdiag_ros import topics
from stepdiag_ros.devices.interferometer import STATUS_COUNT_ERROR, STATUS_OK
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.nodes import sequencer
from stepdiag_ros.nodes.interferometer import InterferometerNode
from stepdiag_ros.nodes.sequencer import SequencerNode
from stepdiag_ros.run.sequence import Sequence, State
from stepdiag_ros.run.supervision import Peer


class JumpyLaser(FakeDevice):
    """A laser whose count is off by as much as the test says, with a status that is good."""

    off = 0.0
    sequence = 0

    def align(self, *_):
        pass

    def update_position(self, *_):
        pass

    def update_environment(self, *_):
        pass

    def poll(self, time_ns):
        JumpyLaser.sequence += 1
        value = JumpyLaser.off
        return [Reading(time_ns, JumpyLaser.sequence, value, value, 1.0, 0, Environment())]


def jumpy(*_):
    return JumpyLaser


def test_a_count_that_jumps_while_the_axes_stand_is_told_with_every_reading(monkeypatch):
    bring_drivers(monkeypatch, ("interferometer", "fake", "test_count_error:jumpy"))
    monkeypatch.setattr(JumpyLaser, "off", 0.0)
    cell = Bench(InterferometerNode)
    try:
        cell.await_state("active")
        cell.begin_run()
        state = cell.states.msg_type(run_id=RUN, state=int(State.RUNNING), line_index=0)
        joints = cell.speaker(topics.JOINT_STATES)

        def go_on(setup, status, also=lambda: True):
            """Publish setup and positions until readings have a status and more holds."""
            state.setup = setup
            readings = cell.heard[topics.READING]
            readings.clear()

            def reached():
                set_now(state, cell.node)
                cell.states.publish(state)
                place = joints.msg_type(name=["X", "Y", "Z"], position=[0.0, 0.0, 0.0])
                set_now(place, cell.node)
                joints.publish(place)
                judged = len(readings) > 20 and all(r.status == status for r in readings[-5:])
                return judged and also()

            cell.until(reached)

        go_on("x", STATUS_OK)
        cell.until(lambda: "beam" in cell.node.facts)
        # On a busy computer positions may be too far apart to judge the readings between them: the
        # jump is compared with a standstill that the check has seen.
        go_on("x", STATUS_OK, lambda: cell.node._count_check._standing is not None)
        JumpyLaser.off = 3e-5
        go_on("x", STATUS_COUNT_ERROR)
        assert cell.node._judge_beam().message.startswith("the count does not fit the way")
        # Another setup has a zero of its own.
        go_on("x #2", STATUS_OK)
    finally:
        cell.executor.shutdown()
        rclpy.try_shutdown()


@pytest.mark.parametrize(
    ("role", "held"), [("cnc_bridge", True), ("interferometer", True), ("weather", False)]
)
def test_a_node_that_was_started_again_within_a_heartbeat_holds_the_run(monkeypatch, role, held):
    monkeypatch.setattr(sequencer, "STOP_LIMIT", 0.1)
    rclpy.init(args=[])
    try:
        node = SequencerNode()
        node.watch.heard(f"/{role}", Peer(role, node.real_time(), "first", ""))
        node._sessions, node._needed = node.watch.sessions(), ()
        node._sequence = Sequence(node._plan, (0.0,) * 3, lambda _: None, lambda: None)
        node._sequence.start(node.now(), node.real_time())
        node.on_heartbeat(Peer(role, node.real_time(), "first", ""))
        assert node._sequence.state is State.RUNNING
        node.on_heartbeat(Peer(role, node.real_time(), "second", ""))
        assert (node._sequence.state is State.FAULT) is held
        if held:
            assert node._sequence.text == f"the {role} node was started again"
    finally:
        rclpy.try_shutdown()
