"""How node processes start: in which environment, and when they join the graph."""

import signal
import subprocess
import sys
import time
from contextlib import nullcontext
from types import SimpleNamespace
from unittest.mock import Mock

import pytest
from domains import own_domain
from patience import PATIENCE
from refused import refused

import stepdiag_ros
from stepdiag_ros.processes import joining, measure
from stepdiag_ros.processes.following import RunFailed
from stepdiag_ros.processes.graph import in_graph
from stepdiag_ros.processes.joining import JoinedRun
from stepdiag_ros.processes.measure import MeasuringSession
from stepdiag_ros.processes.node_process import NodeProcess, Processes, ending, environment
from stepdiag_ros.run.interruption import Terminated
from stepdiag_ros.run.sequence import State


@pytest.mark.skipif(sys.version_info < (3, 11), reason="Python 3.10 always looks where it stands")
def test_nodes_are_of_the_package_that_starts_them_also_beside_another_copy(tmp_path, monkeypatch):
    copy = tmp_path / "stepdiag_ros"
    copy.mkdir()
    (copy / "__init__.py").write_text("")
    monkeypatch.chdir(tmp_path)
    told = [sys.executable, "-c", "import stepdiag_ros; print(stepdiag_ros.__file__)"]
    done = subprocess.run(told, env=environment(), capture_output=True, text=True, check=True)
    assert done.stdout.strip() == stepdiag_ros.__file__


def test_a_held_node_joins_the_graph_only_when_it_is_released(tmp_path):
    with own_domain(), in_graph():
        from stepdiag_ros.nodes.operator import OperatorNode

        operator = OperatorNode()
        try:
            with Processes([NodeProcess("weather")], tmp_path, held=True) as processes:
                assert not operator.spin_until(lambda: bool(operator.watch.peers), 2.0)
                assert not processes.ended()
                processes.release()
                assert operator.spin_until(lambda: bool(operator.watch.peers), PATIENCE)
        finally:
            operator.destroy_node()


def test_a_held_node_ends_when_it_is_told_to_and_leaves_nothing_behind(tmp_path):
    logs = tmp_path / "results" / "logs"
    with Processes([NodeProcess("weather")], logs, held=True) as processes:
        process = processes.running["weather"]
    assert process.returncode == -signal.SIGTERM
    assert not list(tmp_path.iterdir())
    # What was there stays.
    logs.mkdir(parents=True)
    with Processes([NodeProcess("weather")], logs, held=True):
        pass
    assert logs.is_dir()


def test_a_command_joins_the_graph_without_a_word():
    program = "import stepdiag_ros.client\nfrom stepdiag_ros.processes.graph import in_graph\n"
    program += "with in_graph(): pass"
    with own_domain():
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    assert done.stdout + done.stderr == b""


def test_a_lost_node_of_a_cell_is_told_with_the_bag_of_the_run_and_its_lines(tmp_path):
    session = MeasuringSession([], tmp_path, lambda _: None)
    operator = SimpleNamespace(last_state=None)
    lost = SimpleNamespace(ended=lambda: {"solver": "the solver node has ended (SIGKILL)"})
    with refused(RunFailed) as info:
        session._check(operator, lost)
    assert ".mcap" not in str(info.value)
    operator.last_state = SimpleNamespace(run_id="20260203T040506Z-a", line_index=3, line_count=7)
    bag = tmp_path / "20260203T040506Z-a.mcap"
    bag.touch()
    with refused(RunFailed, None, str(bag), "3", "7"):
        session._check(operator, lost)


@pytest.mark.parametrize("code", [-signal.SIGKILL, -signal.SIGSEGV, 3])
@pytest.mark.parametrize("last", ["", "[INFO] [17.5] [cnc_bridge]: controller: active"])
def test_what_a_node_reported_in_health_is_not_given_as_why_it_ended(code, last):
    said = ending("bridge", code, last)
    assert last in said and not said.endswith(f"): {last}")
    # What may be done then is there as well.
    assert len(said) > len(last) + len("the bridge node has ended (exit code 3): ")


def test_a_node_that_says_why_it_ends_is_quoted():
    why = "no device at 'ttyUSB7' (see logs/bridge.log)"
    assert ending("bridge", 1, why).endswith(f"): {why}")
    # It was killed afterwards, so this is not why.
    assert not ending("bridge", -signal.SIGKILL, why).endswith(f"): {why}")


def test_whoever_looks_in_a_wrong_namespace_learns_the_right_one():
    from stepdiag_ros.nodes.base import StepdiagNode

    here = [("sequencer", "/cell_2"), ("sequencer", "/cell_1"), ("recorder", "/cell_3")]
    node = SimpleNamespace(get_node_names_and_namespaces=lambda: here)
    found = StepdiagNode.namespaces_with(node, "sequencer")
    assert "/cell_1, /cell_2" in found and "/cell_3" not in found
    assert StepdiagNode.namespaces_with(node, "clock") == ""


@pytest.mark.parametrize("on_machine", [False, True])
def test_where_nodes_do_not_come_up_it_is_said_what_to_do_and_where_they_wrote(
    tmp_path, monkeypatch, on_machine
):
    monkeypatch.setattr(measure, "START_LIMIT", 0.0)
    session = MeasuringSession([NodeProcess("weather")], tmp_path, lambda _: None)
    session._on_machine = on_machine
    operator = SimpleNamespace(
        real_time=time.monotonic,
        spin_until=lambda *_: False,
        last_state=None,
        watch=SimpleNamespace(peers={}),
    )
    nodes = SimpleNamespace(ended=dict, stopped=dict)
    with refused(RunFailed, None, "0 of 1", str(tmp_path / "logs")) as info:
        session._wait_for_nodes(operator, nodes)
    # A real machine has no factor.
    assert ("--factor" in str(info.value)) == (not on_machine)


def test_a_stopped_run_says_how_many_lines_are_in_which_bag(tmp_path, monkeypatch):
    class Interrupted:
        run_id, measured = "20260203T040506Z-a", None

        def __init__(self, *_):
            pass

        def measure(self, **_):
            raise KeyboardInterrupt

    session = MeasuringSession([], tmp_path, lambda _: None)
    monkeypatch.setattr(measure, "FollowedRun", Interrupted)
    monkeypatch.setattr(session, "_wait_for_nodes", lambda *_: "")
    bag = tmp_path / f"{Interrupted.run_id}.mcap"
    bag.touch()
    state = SimpleNamespace(run_id=Interrupted.run_id, line_index=3, line_count=7)
    with pytest.raises(KeyboardInterrupt) as stopped:
        session._measure(SimpleNamespace(last_state=state), SimpleNamespace())
    assert session.bag == bag
    assert all(word in str(stopped.value) for word in ("3", "7", str(bag)))


def joined(monkeypatch, error, run_id=""):
    """Return what a client says whose run on the nodes of others ends with an error."""
    ended = SimpleNamespace(run_id=run_id, measured=None, measure=Mock(side_effect=error))
    monkeypatch.setattr(joining, "FollowedRun", lambda *_: ended)
    monkeypatch.setattr(joining, "_wait_for_sequencer", lambda *_: None)
    monkeypatch.setattr("stepdiag_ros.nodes.operator.OperatorNode", Mock)
    with pytest.raises(type(error)) as raised, own_domain():
        JoinedRun("", lambda _: None, lambda *_: False).measure("")
    return str(raised.value)


@pytest.mark.parametrize(
    "error", [KeyboardInterrupt(), Terminated(), RunFailed("the sequencer is gone")]
)
def test_whoever_leaves_a_run_behind_learns_its_bag(monkeypatch, error):
    run_id = "20260203T040506Z-a"
    assert f"{run_id}.mcap" in joined(monkeypatch, error, run_id)
    assert ".mcap" not in joined(monkeypatch, error)


def test_whoever_stops_before_a_run_has_begun_is_told_so(monkeypatch):
    def interrupted(*_):
        raise Terminated

    monkeypatch.setattr(joining, "_wait_for_sequencer", interrupted)
    with pytest.raises(Terminated) as raised, own_domain():
        JoinedRun("", lambda _: None, lambda *_: False).measure("")
    assert "no run" in str(raised.value)


@pytest.mark.parametrize(
    ("state", "named"), [(State.RUNNING, True), (State.FINISHED, False), (State.IDLE, False)]
)
def test_a_cell_that_is_ended_in_a_run_names_its_bag(tmp_path, monkeypatch, state, named):
    session = MeasuringSession([], tmp_path, lambda _: None)
    bag = tmp_path / "20260203T040506Z-a.mcap"
    bag.touch()
    told = SimpleNamespace(run_id=bag.stem, state=state, line_index=3, line_count=7)
    operator = SimpleNamespace(last_state=told, spin_until=Mock(side_effect=Terminated))
    monkeypatch.setattr(session, "_started", lambda: nullcontext((operator, None)))
    monkeypatch.setattr(session, "_wait_for_nodes", lambda *_: "")
    with pytest.raises(Terminated) as raised:
        session.keep_up(lambda _: None)
    assert (str(bag) in str(raised.value)) == named


def test_who_keeps_a_cell_sees_each_run_that_somebody_starts(tmp_path):
    told, states = [], iter(
        [
            None,
            *(SimpleNamespace(run_id="one", state=state, text=state.name) for state in
              (State.IDLE, State.RUNNING, State.RUNNING, State.PAUSED, State.RUNNING)),
            *(SimpleNamespace(run_id="one", state=State.ABORTED, text="why"),) * 2,
            SimpleNamespace(run_id="two", state=State.RUNNING, text=""),
        ]
    )  # fmt: skip
    session = MeasuringSession([], tmp_path, lambda news: told.append(news.text))
    operator = SimpleNamespace(last_state=None)

    def spin(*_):
        try:
            operator.last_state = next(states)
        except StopIteration:
            raise Terminated from None

    operator.spin_until = spin
    processes = SimpleNamespace(ended=dict, stopped=dict)
    with pytest.raises(Terminated):
        session._look_on(operator, processes, {})
    assert len(told) == 4
    assert [text.split()[1].rstrip(":") for text in told] == ["one", "one", "one", "two"]
    assert "PAUSED" in told[1] and "why" in told[2]


def test_a_cell_names_the_devices_that_it_waits_for_and_when_they_are_there(tmp_path, monkeypatch):
    told = []
    session = MeasuringSession([], tmp_path, told.append, on_machine=True)
    peer = SimpleNamespace(role="weather", text="no answer of ttyUSB7", faulty=True)
    operator = SimpleNamespace(
        watch=SimpleNamespace(peers={"/cell/weather": peer}), last_state=None
    )
    looks = iter([True, True, False])

    def spin(*_):
        peer.faulty = next(looks, None)
        if peer.faulty is None:
            raise KeyboardInterrupt

    operator.spin_until = spin
    monkeypatch.setattr(session, "_check", lambda *_: False)
    with pytest.raises(KeyboardInterrupt):
        session._look_on(operator, SimpleNamespace(ended=dict), {})
    waits, ready = [news.text for news in told]
    assert "weather" in waits and "ttyUSB7" in waits and "weather" in ready
