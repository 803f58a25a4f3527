"""A run that is asked for while the nodes start waits for them, and for nothing else."""

import time
from types import SimpleNamespace

import pytest
import rclpy
from patience import PATIENCE
from refused import refused
from std_srvs.srv import Trigger

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.nodes.measure_action import START_PATIENCE, NotReadyYet
from stepdiag_ros.nodes.sequencer import REQUIRED, SequencerNode
from stepdiag_ros.run.sequence import State
from stepdiag_ros.run.supervision import Peer


@pytest.fixture
def sequencer():
    rclpy.init(args=[])
    yield SequencerNode()
    rclpy.try_shutdown()


def hear(node, role, faulty=False, text="ready", run_id="", **facts):
    peer = Peer(role, node.real_time(), f"session of {role}", run_id, text, faulty, facts)
    node.watch.heard(f"/{role}", peer)
    node.on_heartbeat(peer)


def stand(node, position=(0.0, 0.0, 0.0)):
    """Let the machine say where it stands."""
    limits = {"soft_limits_low": (-1.0,) * 3, "soft_limits_high": (1.0,) * 3}
    node._machine_state = SimpleNamespace(position=position, **limits)


def refusal(node):
    with refused(Refusal, "not_ready") as caught:
        node.start()
    return caught


def test_only_what_was_never_ready_may_still_come(sequencer):
    stand(sequencer)
    for role in REQUIRED[1:]:
        hear(sequencer, role)
    said = refusal(sequencer)
    assert said.type is NotReadyYet and str(said.value) == "cannot start: there is no " + (
        f"{REQUIRED[0]} node"
    )
    # Who says that something is wrong with him may get ready, as long as all are just starting.
    hear(sequencer, REQUIRED[0], faulty=True, text="waiting for the ROS clock to run")
    assert refusal(sequencer).type is NotReadyYet
    sequencer._made -= START_PATIENCE
    said = refusal(sequencer)
    assert said.type is Refusal and "waiting for the ROS clock" in str(said.value)
    sequencer._made += START_PATIENCE
    # But not if he was ready before, nor if he is silent now.
    hear(sequencer, REQUIRED[0])
    hear(sequencer, REQUIRED[0], faulty=True, text="the link is broken")
    said = refusal(sequencer)
    assert said.type is Refusal and "interferometer: the link is broken" in str(said.value)
    hear(sequencer, REQUIRED[0])
    sequencer.watch.lost["/recorder"] = "recorder node /recorder is silent for 2.1 s"
    said = refusal(sequencer)
    assert said.type is Refusal and "recorder is silent" in str(said.value)


def test_a_node_that_asks_one_that_has_joined_is_waited_for_though_it_was_ready(sequencer):
    """Whoever starts a run just when a node joins must not be refused for that."""
    stand(sequencer)
    for role in REQUIRED:
        hear(sequencer, role)
    sequencer._made -= START_PATIENCE
    hear(sequencer, "recorder", faulty=True, text="asking a new node", getting_ready="yes")
    assert refusal(sequencer).type is NotReadyYet
    hear(sequencer, "recorder")
    assert sequencer.start()


def started(sequencer, *welcome):
    """Let a run begin with the nodes that it requires, and these."""
    stand(sequencer)
    for role in (*REQUIRED, *welcome):
        hear(sequencer, role)
    sequencer.start()
    sequencer._taking_up = None
    sequencer._begin()
    sequencer._update()
    assert sequencer._progress().state is State.RUNNING


@pytest.mark.parametrize("last", REQUIRED)
def test_no_run_begins_before_every_node_has_taken_it_up(sequencer, last):
    """A simulated laser that hears of the run after its first command waits for it for ever."""
    stand(sequencer)
    for role in REQUIRED:
        hear(sequencer, role)
    run_id = sequencer.start()
    for role in REQUIRED:
        hear(sequencer, role, run_id="" if role == last else run_id)
    sequencer._update()
    assert sequencer._after_reset is None and last in sequencer._progress().text
    hear(sequencer, last, run_id=run_id)
    sequencer.watch.deaf = lambda _: []
    sequencer._update()
    assert sequencer._after_reset is not None


def test_no_other_run_begins_while_the_machine_is_made_ready(sequencer):
    """Between the last node's word and the first move the bridge is reset, which may take long."""
    stand(sequencer)
    for role in REQUIRED:
        hear(sequencer, role)
    run_id = sequencer.start()
    sequencer._taking_up = None
    sequencer._reset_machine(sequencer._begin)
    with refused(Refusal, "busy"):
        sequencer.start()
    assert sequencer.run_id == run_id


def test_a_run_that_a_fault_holds_is_not_replaced_by_another(sequencer):
    started(sequencer)
    hear(sequencer, "interferometer", faulty=True, text="no reading has come")
    sequencer._update()
    assert sequencer._progress().state is State.FAULT
    hear(sequencer, "interferometer")
    with refused(Refusal, "busy"):
        sequencer.start()
    sequencer.abort()
    sequencer.start()


def test_a_run_that_is_stopped_by_several_nodes_at_once_names_them_all(sequencer):
    """Whoever mends the first only would be refused, and a silent node may not be the cause."""
    started(sequencer)
    sequencer.watch.lost["/recorder"] = "recorder node /recorder is silent for 2.1 s"
    hear(sequencer, "interferometer", faulty=True, text="no reading has come")
    sequencer._update()
    progress = sequencer._progress()
    assert progress.state is State.FAULT
    for reason in ("/recorder is silent", "interferometer: no reading has come"):
        assert reason in progress.text


@pytest.mark.parametrize("heard", ["before the start", "in the run"])
def test_a_run_is_stopped_by_the_loss_of_a_weather_node_that_it_has_had(sequencer, heard):
    started(sequencer, *(["weather"] if heard == "before the start" else []))
    hear(sequencer, "weather")
    sequencer.watch.lost["/weather"] = "weather node /weather is silent for 2.1 s"
    sequencer._update()
    progress = sequencer._progress()
    assert progress.state is State.FAULT and "/weather" in progress.text


def test_a_bridge_that_has_not_said_where_the_machine_stands_may_still_do_so(sequencer):
    for role in REQUIRED:
        hear(sequencer, role)
    assert refusal(sequencer).type is NotReadyYet
    stand(sequencer, (0.0, float("nan"), 0.0))
    said = refusal(sequencer)
    assert said.type is Refusal and "has not said where the machine stands" in str(said.value)
    stand(sequencer)
    assert sequencer.start()


def test_an_abort_ends_the_wait_too(sequencer):
    """Whoever is told that a run is aborted must not see a machine move later."""
    from rclpy.action import ActionClient

    from stepdiag_ros.nodes.measure_action import measure_type

    asker = rclpy.create_node("asker")
    executor = rclpy.executors.SingleThreadedExecutor()
    for node in (sequencer, asker):
        executor.add_node(node)

    def get(future):
        end = time.monotonic() + PATIENCE
        while not future.done():
            assert time.monotonic() < end, "it does not happen"
            executor.spin_once(timeout_sec=0.02)
        return future.result()

    client = ActionClient(asker, measure_type(), "sequencer/measure")
    abort = asker.create_client(Trigger, "sequencer/abort")
    end = time.monotonic() + PATIENCE
    while not (client.server_is_ready() and abort.service_is_ready()):
        assert time.monotonic() < end, "no sequencer"
        executor.spin_once(timeout_sec=0.02)
    assert not get(abort.call_async(Trigger.Request())).success
    answer = get(client.send_goal_async(measure_type().Goal())).get_result_async()
    while sequencer._measure._waiting is None:
        executor.spin_once(timeout_sec=0.02)
    assert get(abort.call_async(Trigger.Request())).success
    stand(sequencer)
    for role in REQUIRED:
        hear(sequencer, role)
    assert get(answer).result.text == "aborted by the operator, before it began"
    assert sequencer._sequence is None and sequencer.run_id == ""
    # A run that goes on is aborted as before, though no goal waits.
    sequencer.start()
    assert get(abort.call_async(Trigger.Request())).success
    assert sequencer._progress().state is State.ABORTED
    executor.shutdown()
