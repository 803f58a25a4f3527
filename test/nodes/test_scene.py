"""The scene alone: frames and markers of a run, whole for a viewer that comes late."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import rclpy
from patience import PATIENCE
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import SetParameters
from refused import refused

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.configuration import load_cell, load_machine, plan_from_text
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.messages.volumetric import from_volumetric_errors
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers import solve_all
from stepdiag_ros.run.sequence import State

RUN_ID = "20260102T030405-abcd"
PLAN = """\
name: a small box
origin_m: [0.01, 0.02, 0.03]
step_m: [0.01, 0.02, 0.01]
blocks: 4
directions: [forward]
feed_m_per_s: 0.05
lines:
  - {kind: linear, names: [x, y, z]}
  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn]}
"""


def filled(topic, **fields):
    message = conversion.new_message(topic.type_name)
    set_header(message, 1_000_000_000)
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def groups(array):
    return {marker.ns for marker in array.markers if marker.ns}


class Viewer:
    """What a viewer that subscribes now sees: the newest of each topic."""

    def __init__(self, operator):
        self.errors = self.run = None
        self.fixed, self.moving = {}, {}
        operator.listen(topics.ERROR_MARKERS, lambda array: setattr(self, "errors", array))
        operator.listen(topics.RUN_MARKERS, lambda array: setattr(self, "run", array))
        operator.listen(topics.FIXED_FRAMES, lambda tf: self._take(tf, self.fixed))
        operator.listen(topics.FRAMES, lambda tf: self._take(tf, self.moving))

    def _take(self, message, frames):
        for one in message.transforms:
            at = one.transform.translation
            frames[one.child_frame_id] = (one.header.frame_id, (at.x, at.y, at.z))


def test_a_viewer_sees_the_run_whenever_it_comes(tmp_path: Path):
    from stepdiag_ros.nodes.operator import OperatorNode
    from stepdiag_ros.processes.node_process import NodeProcess, Processes

    plan = plan_from_text(PLAN, "test plan")
    measurement = simulate(plan, load_cell("demo")[0])
    results, _ = solve_all(Measurement(plan.volume, measurement.lines, "YXZ"))
    rclpy.init(args=[])
    operator = OperatorNode()
    viewer = Viewer(operator)
    outlets = {
        topic: operator.announce(topic)
        for topic in (
            topics.RUN_DESCRIPTION,
            topics.RUN_STATE,
            topics.LINE,
            topics.VOLUMETRIC_ERRORS,
            topics.JOINT_STATES,
        )
    }

    def say(topic, **fields):
        outlets[topic].publish(filled(topic, **fields))

    def seen(condition, limit=PATIENCE):
        assert operator.spin_until(condition, limit)

    def setup(index, state=State.RUNNING):
        line = plan.lines[index]
        say(
            topics.RUN_STATE,
            run_id=RUN_ID,
            state=int(state),
            line_index=index,
            setup=line.setup,
        )

    try:
        with Processes([NodeProcess("scene", {"frame_prefix": "cell_1/"})], tmp_path):
            peers = operator.watch.peers
            seen(lambda: any(peer.role == "scene" for peer in peers.values()))

            # Before any run: the tool alone, and no word of a box or of a setup.
            # Positions are heard on best effort: one that comes too early is not sent again.
            def moved():
                # A robot beside the machine may use the topic too.
                say(topics.JOINT_STATES, name=["A1", "A2"], position=[1.0, 2.0])
                say(topics.JOINT_STATES, name=["X", "Y", "Z"], position=[0.02, 0.02, 0.04])
                return viewer.moving

            seen(moved)
            assert viewer.moving["cell_1/tool"] == ("cell_1/machine", (0.02, 0.02, 0.04))
            assert not viewer.fixed and viewer.errors is None and viewer.run is None

            # A result that comes before the description of its run is not lost.
            least_squares = results["least_squares"]
            message = from_volumetric_errors(least_squares, RUN_ID, 2_000_000_000)
            outlets[topics.VOLUMETRIC_ERRORS].publish(message)
            machine = load_machine("demo")[1]
            say(topics.RUN_DESCRIPTION, run_id=RUN_ID, plan=PLAN, machine=machine)
            setup(0)
            seen(lambda: viewer.errors and "least_squares/vectors" in groups(viewer.errors))
            seen(lambda: viewer.run and "beam" in groups(viewer.run))
            assert viewer.fixed["cell_1/workpiece"] == ("cell_1/machine", (0.01, 0.02, 0.03))
            assert viewer.fixed["cell_1/mirror"][0] == "cell_1/tool"
            np.testing.assert_allclose(
                viewer.fixed["cell_1/laser"][1], (0.01 - 0.3, 0.02, 0.03), atol=1e-12
            )

            # The next setup: the laser stands elsewhere, its line is the one that is done.
            for line in measurement.lines[:2]:
                outlets[topics.LINE].publish(conversion.from_measured_line(line, RUN_ID))
            setup(1)
            seen(lambda: abs(viewer.fixed["cell_1/laser"][1][1] - (0.02 - 0.3)) < 1e-12)
            names = "line_names"
            seen(lambda: "y  1/1" in [m.text for m in viewer.run.markers if m.ns == names])

            # Another method, while it runs; who comes now sees all of it, in one message a topic.
            client = operator.create_client(SetParameters, "/scene/set_parameters")
            assert client.wait_for_service(PATIENCE)
            request = SetParameters.Request()
            request.parameters = [filled_parameter("method", "conventional")]
            outlets[topics.VOLUMETRIC_ERRORS].publish(
                from_volumetric_errors(results["conventional"], RUN_ID, 2_000_000_000)
            )
            answer = client.call_async(request)
            seen(answer.done)
            assert answer.result().results[0].successful
            seen(lambda: "conventional/vectors" in groups(viewer.errors))
            assert not any(name.startswith("least_squares") for name in groups(viewer.errors))
            late = Viewer(operator)
            seen(lambda: late.errors and late.run and len(late.fixed) == 3)
            assert late.fixed == viewer.fixed and late.errors == viewer.errors
            frames = {m.header.frame_id for m in (*late.errors.markers, *late.run.markers)}
            assert frames == {"cell_1/machine", "cell_1/laser", "cell_1/mirror"}

            # What cannot be a result is said, and the scene goes on.
            say(topics.VOLUMETRIC_ERRORS, run_id=RUN_ID, method="soons", e_xx=[1.0])
            said = "a message on result/volumetric_errors cannot be used: VolumetricErrors: E_XX"
            seen(lambda: any(peer.text.startswith(said) for peer in peers.values()))

            # The end: the optics are gone, the result stays.
            setup(1, State.FINISHED)
            seen(lambda: not {"laser", "beam", "mirror"} & groups(viewer.run))
            assert "conventional/vectors" in groups(viewer.errors)

            # A new run begins with an empty box.
            say(topics.RUN_DESCRIPTION, run_id="another", plan=PLAN, machine=machine)
            seen(lambda: groups(viewer.errors) == {"box"})
    finally:
        operator.destroy_node()
        rclpy.try_shutdown()


def filled_parameter(name, text):
    parameter = conversion.new_message("rcl_interfaces/msg/Parameter")
    parameter.name = name
    parameter.value.type = ParameterType.PARAMETER_STRING
    parameter.value.string_value = text
    return parameter


def test_a_scene_may_be_there_before_a_measurement():
    from stepdiag_ros.processes.measure import MeasuringSession, RunFailed
    from stepdiag_ros.run.supervision import Peer, Watch

    operator = SimpleNamespace(watch=Watch(), spin_until=lambda condition, _limit: condition())
    session = MeasuringSession([], Path(), lambda _told: None)
    operator.watch.heard("/scene", Peer("scene", 0.0, "a", ""))
    session._refuse_company(operator)
    operator.watch.heard("/solver", Peer("solver", 0.0, "b", ""))
    with refused(RunFailed, "busy", "/solver"):
        session._refuse_company(operator)


def test_simulated_time_keeps_a_simulated_cell_from_starting_and_a_machine_not():
    from stepdiag_ros.processes.measure import MeasuringSession, RunFailed
    from stepdiag_ros.processes.node_process import NodeProcess
    from stepdiag_ros.run.supervision import Peer, Watch

    operator = SimpleNamespace(watch=Watch(), spin_until=lambda condition, _limit: condition())
    operator.watch.heard("/elsewhere/clock", Peer("clock", 0.0, "a", ""))
    MeasuringSession([NodeProcess("solver")], Path(), lambda _told: None)._refuse_company(operator)
    simulated = [NodeProcess("solver"), NodeProcess("clock")]
    with refused(RunFailed, "busy", "/elsewhere/clock", "/clock"):
        MeasuringSession(simulated, Path(), lambda _told: None)._refuse_company(operator)


def test_a_replay_leaves_frames_pictures_and_time_to_live_nodes():
    """``ros2 bag record --all`` keeps them; played, they would contradict the live ones."""
    from stepdiag_ros.nodes.player import PlayerNode

    kept = (topics.RUN_STATE, topics.FRAMES, topics.FIXED_FRAMES, topics.ERROR_MARKERS)
    recorded = {topics.absolute(one): one.type_name for one in kept}
    bag = SimpleNamespace(topics=recorded, types=own_types())
    rclpy.init(args=[])
    try:
        player = PlayerNode(bag, SimpleNamespace(namespace="/"), derived=False, late=False)
        player.open()
        # /clock is the player's own.
        played = {
            name for name, _ in player.get_publisher_names_and_types_by_node("stepdiag_player", "/")
        }
        assert "/run/state" in played and "/clock" in played
        assert not played & {topics.absolute(one) for one in kept[1:]}
        player.destroy_node()
    finally:
        rclpy.try_shutdown()
