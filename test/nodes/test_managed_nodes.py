"""Device nodes are managed nodes: what they do in each state, and what becomes of a failure."""

import time

import fake_devices
import pytest
import rclpy
from drivers_for_tests import bring_drivers
from fake_devices import FakeCnc, asked, broken
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from patience import PATIENCE
from rclpy.executors import SingleThreadedExecutor
from refused import refused
from std_srvs.srv import Trigger

from stepdiag_ros import topics
from stepdiag_ros.configuration import load_machine, load_plan
from stepdiag_ros.devices.cnc import CncState
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.nodes.base import spin
from stepdiag_ros.nodes.bridge import BridgeNode
from stepdiag_ros.nodes.interferometer import InterferometerNode
from stepdiag_ros.nodes.links import message_class, quality
from stepdiag_ros.run.health import Level
from stepdiag_ros.run.sequence import Answer, State

RUN = "20260101T000000Z-abcdef"
PARAMETERS = ("device:=fake", "retry_after:=0.3")
SILENCE = 0.15
"""Real seconds in which a device that streams would have been heard many times."""


@pytest.fixture(autouse=True)
def drivers(monkeypatch):
    fake_devices.forget()
    monkeypatch.setattr(FakeCnc, "braking", False)
    bring_drivers(
        monkeypatch,
        ("cnc", "fake", "fake_devices:cnc"),
        ("interferometer", "fake", "fake_devices:laser"),
    )


class Bench:
    """One device node in this process, and a manager who hears it and asks it for things."""

    def __init__(self, kind, *parameters):
        given = [word for entry in (*PARAMETERS, *parameters) for word in ("-p", entry)]
        rclpy.init(args=["--ros-args", *given])
        self.node = kind()
        self.manager = rclpy.create_node("manager")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.executor.add_node(self.manager)
        self.heard = {
            topic: self.hear(topic)
            for topic in (
                topics.READING,
                topics.JOINT_STATES,
                topics.MACHINE_STATE,
                topics.COMMAND_STATUS,
                topics.DIAGNOSTICS,
            )
        }
        self.commands = self.speaker(topics.MACHINE_COMMAND)
        self.permits = self.speaker(topics.MOTION_PERMIT)
        self.descriptions = self.speaker(topics.RUN_DESCRIPTION)
        self.states = self.speaker(topics.RUN_STATE)

    def hear(self, topic):
        heard = []
        self.manager.create_subscription(
            message_class(topic), topic.name, heard.append, quality(topic)
        )
        return heard

    def speaker(self, topic):
        return self.manager.create_publisher(message_class(topic), topic.name, quality(topic))

    def until(self, condition, limit=PATIENCE):
        deadline = time.monotonic() + limit
        while not condition():
            assert time.monotonic() < deadline, (self.said(), asked)
            self.executor.spin_once(0.02)

    def said(self):
        """Return level and text of the last heartbeat that was heard, and the state it told."""
        for array in reversed(self.heard[topics.DIAGNOSTICS]):
            for status in array.status:
                facts = {entry.key: entry.value for entry in status.values}
                if "session" in facts:
                    return ord(status.level), status.message, facts["lifecycle"]
        return None, "", ""

    def await_state(self, state, text=""):
        self.until(lambda: self.said()[2] == state and text in self.said()[1])

    def change(self, **transition):
        request = ChangeState.Request(transition=Transition(**transition))
        return self._call(ChangeState, "change_state", request).success

    def trigger(self, service):
        return self._call(Trigger, service, Trigger.Request())

    def _call(self, kind, service, request):
        client = self.manager.create_client(kind, f"{self.node.get_name()}/{service}")
        self.until(client.service_is_ready)
        future = client.call_async(request)
        self.until(future.done)
        self.manager.destroy_client(client)
        return future.result()

    def streamed(self, topic):
        """Return how many messages come from now on, once what was on its way has come."""
        for messages in (self.heard[topic], self.heard[topic]):
            messages.clear()
            end = time.monotonic() + SILENCE
            self.until(lambda end=end: time.monotonic() > end)
        return len(self.heard[topic])

    def begin_run(self):
        description = message_class(topics.RUN_DESCRIPTION)(
            run_id=RUN,
            schema_version=1,
            plan=load_plan("quick")[1],
            machine=load_machine("demo")[1],
        )
        self.descriptions.publish(description)
        self.until(lambda: self.node.run_id == RUN)

    def send(self, number, x, **fields):
        """Ask for a move as a sequencer would, but without the permit."""
        given = {"run_id": RUN, "command_id": number, "purpose": 1, "axis": "X", "feed": 0.01}
        message = message_class(topics.MACHINE_COMMAND)(
            **{**given, "target": [x, 0.0, 0.0], **fields}
        )
        if not message.header.stamp.sec:
            set_now(message, self.node)
        self.commands.publish(message)

    def permit(self, number):
        self.permits.publish(message_class(topics.MOTION_PERMIT)(run_id=RUN, command_id=number))

    def command(self, number, x):
        self.permit(number)
        self.send(number, x)
        answers = self.heard[topics.COMMAND_STATUS]
        self.until(lambda: any(answer.command_id == number for answer in answers))
        return [answer for answer in answers if answer.command_id == number][-1]


@pytest.fixture
def bench():
    made = []

    def make(kind, *parameters):
        made.append(Bench(kind, *parameters))
        return made[-1]

    yield make
    for item in made:
        item.node.close()
    rclpy.try_shutdown()


def test_a_manager_leads_a_device_through_its_states(bench, capfd):
    cell = bench(InterferometerNode, "autostart:=false")
    cell.await_state("unconfigured")
    level, text, _ = cell.said()
    assert level == 2
    assert "the device is not open; ros2 lifecycle set /interferometer configure" in text
    assert asked == []

    # There is no such transition now; the node outlives being asked for it.
    assert not cell.change(id=Transition.TRANSITION_ACTIVATE)
    assert not cell.change(label="nonsense")
    assert cell.change(id=Transition.TRANSITION_CONFIGURE)
    cell.await_state("inactive", "ros2 lifecycle set /interferometer activate")
    assert cell.said()[0] == 2
    assert cell.streamed(topics.READING) == 0
    assert asked[0] == "open" and "poll" in asked, "what it has to say is read and dropped"

    assert cell.change(id=Transition.TRANSITION_ACTIVATE)
    cell.await_state("active")
    assert cell.said()[:2] == (0, "ready")
    assert "active (fake)" in capfd.readouterr().err, "the log names the driver"
    assert cell.streamed(topics.READING) > 5

    assert cell.change(id=Transition.TRANSITION_DEACTIVATE)
    assert cell.streamed(topics.READING) == 0
    cell.await_state("inactive")
    assert "close" not in asked
    assert cell.change(id=Transition.TRANSITION_CLEANUP)
    cell.await_state("unconfigured")
    assert asked[-1] == "close"

    assert cell.change(label="configure") and cell.change(label="activate")
    cell.await_state("active")
    assert cell.change(id=Transition.TRANSITION_ACTIVE_SHUTDOWN)
    cell.await_state("finalized", "start the node again")
    assert asked[-1] == "close" and asked.count("open") == asked.count("close") == 2
    assert not cell.change(id=Transition.TRANSITION_CONFIGURE)


def test_a_client_library_that_raises_at_an_impossible_transition_does_not_end_the_node(bench):
    def change(*_):
        raise RuntimeError("rclpy of ROS 2 Jazzy raises its RCLError")

    cell = bench(InterferometerNode, "autostart:=false")
    (service,) = [one for one in cell.node.services if one.srv_name.endswith("/change_state")]
    service.callback = cell.node._refusing(change)
    assert not cell.change(id=Transition.TRANSITION_ACTIVATE)
    cell.await_state("unconfigured")


def test_a_device_that_cannot_be_opened_is_tried_again(bench):
    broken["open"] = OSError("no answer from 192.0.2.1")
    cell = bench(InterferometerNode)
    cell.await_state("unconfigured", "cannot open the interferometer: no answer from 192.0.2.1")
    assert "opened again in 0.3 s" in cell.said()[1] and cell.said()[0] == 2
    cell.until(lambda: asked.count("open") >= 2)
    assert cell.node.device is None
    broken.clear()
    cell.await_state("active")
    assert cell.said()[0] == 0


def test_without_autostart_a_failure_waits_for_the_manager(bench):
    cell = bench(InterferometerNode, "autostart:=false")
    broken["open"] = ValueError("it speaks another protocol")
    assert not cell.change(id=Transition.TRANSITION_CONFIGURE)
    cell.await_state("unconfigured", "configure and activate the node")
    assert "cannot open the interferometer: it speaks another protocol" in cell.said()[1]
    broken["open"] = KeyError("a mistake in the driver")
    assert not cell.change(id=Transition.TRANSITION_CONFIGURE)
    cell.await_state("unconfigured", "KeyError: 'a mistake in the driver'")
    broken.clear()
    assert cell.change(id=Transition.TRANSITION_CONFIGURE)
    broken["poll"] = OSError("the line is dead")
    cell.await_state("unconfigured", "cannot read the interferometer: the line is dead")
    assert asked[-1] == "close"
    assert cell.change(id=Transition.TRANSITION_CONFIGURE) is True


def test_nothing_is_opened_before_the_ros_clock_runs(bench):
    cell = bench(InterferometerNode, "use_sim_time:=true")
    cell.await_state("unconfigured", "waiting for the ROS clock to run")
    assert not cell.change(id=Transition.TRANSITION_CONFIGURE)
    assert asked == []
    clock = cell.speaker(topics.CLOCK)
    time_of_day = message_class(topics.CLOCK)()
    time_of_day.clock.sec = 1
    clock.publish(time_of_day)
    cell.await_state("active")


def test_what_a_manager_did_is_not_undone_by_the_retry(bench):
    broken["open"] = OSError("no answer")
    cell = bench(InterferometerNode)
    cell.await_state("unconfigured", "no answer")
    broken.clear()
    assert cell.change(label="configure") and cell.change(label="cleanup")
    end = time.monotonic() + 0.5
    cell.until(lambda: time.monotonic() > end)
    cell.await_state("unconfigured", "ros2 lifecycle set")
    assert cell.node.device is None


def test_no_beam_is_set_up_while_inactive_and_a_failed_alignment_closes_the_instrument(bench):
    cell = bench(InterferometerNode)
    cell.await_state("active")
    cell.begin_run()
    assert cell.change(id=Transition.TRANSITION_DEACTIVATE)
    state = message_class(topics.RUN_STATE)(run_id=RUN, state=1, setup="x")

    def tell():
        set_now(state, cell.manager)
        cell.states.publish(state)

    tell()
    cell.streamed(topics.READING)
    assert "align x" not in asked
    assert cell.change(id=Transition.TRANSITION_ACTIVATE)
    tell()
    cell.until(lambda: "beam" in cell.node.facts)
    assert asked.count("align x") == 1
    broken["align y"] = OSError("the mirror motor is stuck")
    state.setup = "y"
    tell()
    cell.await_state("unconfigured", "cannot align the interferometer for y: the mirror motor")
    assert "beam" not in cell.node.facts
    cell.await_state("active")
    assert cell.said()[0] == 0


def test_a_device_is_heard_before_it_is_judged_by_its_silence(bench):
    cell = bench(InterferometerNode, "reading_timeout:=0.3")
    cell.await_state("active")
    (beam,) = (task for task in cell.node.health._tasks if task.name == "beam")
    # Nothing of this process runs for a while, as on a busy computer; then comes this first.
    time.sleep(0.4)
    cell.node._look_around()
    assert beam.found.level is not Level.STALE and not beam.found.forbids


def set_now(message, node):
    message.header.stamp = node.get_clock().now().to_msg()


def test_a_bridge_that_is_deactivated_stops_the_machine_and_moves_nothing_until_active(bench):
    cell = bench(BridgeNode, "silence_limit:=10.0")
    cell.await_state("active")
    cell.begin_run()
    assert cell.trigger("reset").success
    assert cell.command(1, 0.01).status in (Answer.ACCEPTED, Answer.MOVING)
    FakeCnc.braking = True
    assert cell.change(id=Transition.TRANSITION_DEACTIVATE)
    assert "stop" in asked
    assert cell.streamed(topics.JOINT_STATES) == 0
    assert not cell.change(id=Transition.TRANSITION_CLEANUP), "the axes still move"
    FakeCnc.braking = False
    states = cell.heard[topics.MACHINE_STATE]
    cell.until(lambda: states[-1].state == CncState.STOPPED)
    assert states[-1].reason == "the node is deactivated"
    cell.until(lambda: cell.heard[topics.COMMAND_STATUS][-1].status == Answer.STOPPED)

    assert cell.command(2, 0.01).status == Answer.REJECTED
    assert cell.command(2, 0.01).reason == "the bridge is not active"
    refused = cell.trigger("reset")
    assert not refused.success and "not active" in refused.message

    assert cell.change(id=Transition.TRANSITION_ACTIVATE)
    cell.until(lambda: cell.streamed(topics.JOINT_STATES) > 5)
    assert cell.heard[topics.MACHINE_STATE][-1].state == CncState.STOPPED
    assert asked.count("start_move") == 1, "no transition moves the machine"
    assert cell.trigger("reset").success
    assert cell.command(3, 0.01).status in (Answer.ACCEPTED, Answer.MOVING)


def test_a_controller_that_fails_in_a_move_is_stopped_closed_and_opened_anew(bench):
    cell = bench(BridgeNode, "silence_limit:=10.0")
    cell.await_state("active")
    cell.begin_run()
    assert cell.trigger("reset").success
    cell.command(1, 0.01)
    broken["poll"] = OSError("connection reset")
    broken["stop"] = RuntimeError("a mistake in the driver")
    cell.await_state("unconfigured", "cannot read the controller: connection reset")
    said = cell.said()[1]
    assert "could not be stopped (a mistake in the driver): use the emergency stop" in said
    answer, state = cell.heard[topics.COMMAND_STATUS], cell.heard[topics.MACHINE_STATE]
    cell.until(lambda: answer[-1].status == Answer.FAULT and state[-1].state == CncState.FAULT)
    assert "connection reset" in state[-1].reason
    assert all(value != value for value in state[-1].position), "nobody knows where it is"
    stopped = cell.trigger("stop")
    assert not stopped.success and "cannot be stopped through it" in stopped.message
    assert cell.node.device is None and asked[-1] == "close"
    broken.clear()
    cell.await_state("active")
    cell.until(lambda: state[-1].state == CncState.READY)
    assert tuple(state[-1].position) == (0.0, 0.0, 0.0)
    assert cell.trigger("reset").success
    broken["start_move"] = OSError("no answer")
    assert cell.command(2, 0.01).status == Answer.FAULT
    cell.await_state("unconfigured", "cannot start a move: no answer")


def test_a_clock_that_is_set_back_in_a_move_stops_the_machine(bench, monkeypatch):
    cell = bench(BridgeNode, "silence_limit:=10.0")
    cell.await_state("active")
    cell.begin_run()
    assert cell.trigger("reset").success
    cell.command(1, 0.01)
    now = cell.node.now
    monkeypatch.setattr(cell.node, "now", lambda: now() - 3_600_000_000_000)
    cell.await_state("unconfigured", "set back by 3600.0 s")
    assert asked[-2:] == ["stop", "close"]
    cell.until(lambda: cell.heard[topics.COMMAND_STATUS][-1].status == Answer.FAULT)
    cell.await_state("active")
    assert asked.count("start_move") == 1


def test_a_crash_leaves_no_machine_in_motion(monkeypatch):
    arguments = [word for entry in PARAMETERS for word in ("-p", entry)]
    monkeypatch.setattr("sys.argv", ["bridge", "--ros-args", *arguments])
    mistake = broken["poll"] = RuntimeError("a mistake in the driver")

    class Crashing(BridgeNode):
        def on_open(self, device):
            """Leave out the first look, so that the crash is in a callback of its own."""

    with pytest.raises(RuntimeError) as caught:
        spin(Crashing)
    assert caught.value is mistake
    assert asked[-3:] == ["poll", "stop", "close"]


def test_a_device_that_is_deactivated_holds_the_run_until_it_is_active_again(make_cell):
    def change(name, transition):
        client = cell.operator.create_client(ChangeState, f"{name}/change_state")
        cell.wait(client.service_is_ready, f"{name} can be led")
        future = client.call_async(ChangeState.Request(transition=Transition(label=transition)))
        cell.wait(future.done, f"{name} answers")
        assert future.result().success

    def refused_as_inactive():
        try:
            cell.operator.start()
        except ValueError as error:
            return "interferometer: inactive" in str(error)
        # The sequencer had not heard of it yet; a run without readings would not get far.
        cell.operator.call("sequencer/abort")
        return False

    with make_cell() as cell:
        change("interferometer", "deactivate")
        cell.wait(refused_as_inactive, "no run starts without the interferometer")
        change("interferometer", "activate")
        cell.start()
        for name, stops in (("interferometer", 3), ("cnc_bridge", 6)):
            cell.wait(lambda stops=stops: len(cell.stops) >= stops, f"{stops} stops")
            change(name, "deactivate")
            cell.wait_for_state(State.FAULT)
            with refused(Refusal, "rejected", "resume", name):
                cell.operator.call("sequencer/resume")
            change(name, "activate")
            cell.resume()
        cell.wait_for_state(State.FINISHED)
        lines = set(range(6))
        cell.wait(lambda: {one.line_index for one in cell.lines} == lines, "all lines")
