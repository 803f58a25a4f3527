"""The action ~/measure: goals that are refused, held, cancelled, overtaken, and a whole cell."""

import contextlib
import json
import math
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from patience import PATIENCE
from refused import refused

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros.cli import main
from stepdiag_ros.configuration import load_plan
from stepdiag_ros.messages.target import target_of
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.target import TargetStanding, TargetState
from stepdiag_ros.nodes import interrupts
from stepdiag_ros.run.interruption import Terminated
from stepdiag_ros.run.sequence import Progress, State

EXECUTING, SUCCEEDED, CANCELED, ABORTED = 2, 4, 5, 6
FINISHED_OUTCOME, ABORTED_OUTCOME, REFUSED_OUTCOME = 1, 2, 3


class Bench:
    """The action alone, on a node whose runs the test makes up, and a client of it."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.action import ActionClient
        from rclpy.executors import SingleThreadedExecutor

        from stepdiag_ros.nodes.base import StepdiagNode
        from stepdiag_ros.nodes.measure_action import MeasureAction, NotReadyYet, measure_type

        class Host(StepdiagNode):
            role = "sequencer"

        rclpy.init(args=[])
        self.state, self.text, self.plans, self.reasons = State.IDLE, "nothing", [], []
        self.standing = None
        self.refusal, self.unheard, self.not_ready_yet = "", "", NotReadyYet
        self.host, self.asker = Host("sequencer"), rclpy.create_node("asker")
        self.action = MeasureAction(
            self.host, self._begin, self._abort, self._progress, lambda: ["ppp: stop 3: no beam"]
        )
        self.host.every(0.01, self.action.update, real=True)
        self.executor = SingleThreadedExecutor()
        for node in (self.host, self.asker):
            self.executor.add_node(node)
        self.client = ActionClient(self.asker, measure_type(), "sequencer/measure")
        self.goal = measure_type().Goal
        self.feedback = []
        self.spin(self.client.server_is_ready)

    def spin(self, done, limit=PATIENCE):
        end = time.monotonic() + limit
        while not done():
            assert time.monotonic() < end, "it does not happen"
            self.executor.spin_once(timeout_sec=0.05)

    def get(self, future):
        self.spin(future.done)
        return future.result()

    def send(self, plan="", until=""):
        """Return the handle of a goal and the future of its result."""
        heard = lambda message: self.feedback.append(message.feedback)  # noqa: E731
        handle = self.get(self.client.send_goal_async(self.goal(plan=plan, until=until), heard))
        assert handle.accepted
        return handle, handle.get_result_async()

    def _begin(self, plan, until):
        if self.refusal:
            raise ValueError(self.refusal)
        if self.unheard:
            raise self.not_ready_yet(self.unheard)
        self.action.run_begins()
        self.plans.append(plan)
        self.until = until
        self.state, self.text = State.RUNNING, "measuring"
        return f"run {len(self.plans)}"

    def _abort(self, reason):
        if self.state in (State.FINISHED, State.ABORTED):
            raise ValueError("cannot abort")
        self.reasons.append(reason)
        self.state, self.text = State.ABORTED, reason

    def _progress(self):
        return Progress(
            *(self.state, 1, 4, "x forward, repeat 0", "x", 2, 3, 5, 10, 17, 40, math.nan),
            *(self.text, self.standing),
        )


@pytest.fixture
def bench(monkeypatch):
    import rclpy

    # A goal that waits for nodes waits for as long as the test may take.
    monkeypatch.setattr("stepdiag_ros.nodes.measure_action.START_PATIENCE", PATIENCE)
    made = Bench()
    yield made
    made.executor.shutdown()
    rclpy.try_shutdown()


def test_a_goal_may_have_a_target_and_its_feedback_says_how_far_it_is(bench):
    bench.standing = TargetStanding(
        "E_XX", "m", 1e-6, 2e-6, 8e-7, 60.0, TargetState.OPEN, 3, "U is 2 µm"
    )
    _, answer = bench.send("quick", until="E_XX=1um")
    bench.spin(lambda: bench.feedback)
    assert bench.until == "E_XX=1um"
    assert target_of(bench.feedback[0]) == bench.standing
    bench.state = State.FINISHED
    bench.get(answer)


def test_a_goal_is_executed_to_its_end(bench):
    handle, answer = bench.send("quick")
    bench.spin(lambda: bench.feedback)
    told = bench.feedback[0]
    assert (told.run_id, told.state, told.line_index, told.line_count) == ("run 1", 1, 1, 4)
    assert (told.line, told.block, told.block_count) == ("x forward, repeat 0", 2, 3)
    assert (told.stop, told.stop_count, told.stops_done, told.stops_total) == (5, 10, 17, 40)
    assert math.isnan(told.remaining_time) and told.text == "measuring"
    bench.spin(lambda: handle.status == EXECUTING)
    assert not answer.done()
    bench.state, bench.text = State.FINISHED, "all lines are measured"
    response = bench.get(answer)
    assert response.status == SUCCEEDED
    result = response.result
    assert result.outcome == FINISHED_OUTCOME and result.text == "all lines are measured"
    assert result.run_id == "run 1" and (result.stops_done, result.stops_total) == (17, 40)
    assert list(result.incomplete) == ["ppp: stop 3: no beam"]
    assert result.verdict == "UNKNOWN" and "no diagnosis node" in result.sentence
    assert result.bag == "" and not result.bag_closed
    assert bench.plans == ["quick"]


def test_a_refusal_says_why_and_leaves_the_present_run_alone(bench):
    _, first = bench.send()
    bench.refusal = "run 1 is going on: wait for its end, or abort it"
    response = bench.get(bench.send("demo")[1])
    assert response.status == ABORTED and response.result.outcome == REFUSED_OUTCOME
    assert response.result.text == bench.refusal and response.result.run_id == ""
    assert response.result.verdict == "UNKNOWN" and response.result.stops_total == 0
    assert not first.done() and bench.state is State.RUNNING
    bench.state = State.FINISHED
    assert bench.get(first).status == SUCCEEDED


def test_cancelling_ends_the_run(bench):
    handle, answer = bench.send()
    assert len(bench.get(handle.cancel_goal_async()).goals_canceling) == 1
    assert bench.reasons == ["cancelled by the client that requested the run"]
    response = bench.get(answer)
    assert response.status == CANCELED and response.result.outcome == ABORTED_OUTCOME
    assert response.result.text == bench.reasons[0] and response.result.run_id == "run 1"


def test_an_operator_who_is_interrupted_while_a_run_begins_leaves_none(bench, monkeypatch):
    import rclpy

    from stepdiag_ros.nodes.operator import OperatorNode

    operator = OperatorNode()
    bench.executor.add_node(operator)
    spin_once = bench.executor.spin_once
    monkeypatch.setattr(rclpy, "spin_once", lambda _, timeout_sec: spin_once(timeout_sec))
    monkeypatch.setattr(operator, "_begun", lambda _: signal.raise_signal(signal.SIGINT))
    with interrupts.raised(), pytest.raises(KeyboardInterrupt):
        operator.start()
    assert bench.reasons == ["cancelled by the client that requested the run"]


def test_an_interrupt_waits_until_a_message_is_handled():
    handled = []
    with interrupts.raised():
        with pytest.raises(Terminated), interrupts.held():
            signal.raise_signal(signal.SIGTERM)
            handled.append("message")
        with interrupts.held():
            handled.append("the next")
    assert handled == ["message", "the next"]


def test_a_run_that_somebody_else_aborts_aborts_its_goal(bench):
    _, answer = bench.send()
    bench.state, bench.text = State.ABORTED, "aborted by the operator"
    response = bench.get(answer)
    assert response.status == ABORTED and response.result.outcome == ABORTED_OUTCOME
    assert response.result.text == "aborted by the operator"


def test_a_fault_holds_the_goal_until_another_run_takes_its_place(bench):
    _, answer = bench.send()
    bench.state, bench.text = State.FAULT, "the beam is lost"
    bench.action.tell()
    bench.spin(lambda: bench.feedback and bench.feedback[-1].text == "the beam is lost")
    assert bench.feedback[-1].state == State.FAULT and not answer.done()
    _, second = bench.send()
    response = bench.get(answer)
    assert response.status == ABORTED and response.result.run_id == "run 1"
    assert response.result.text == "stopped by a fault and given up: another run was started"
    assert not second.done()


def test_results_that_are_owed_are_waited_for_unless_the_client_cancels(bench):
    from stepdiag_ros.run.supervision import Peer

    handle, answer = bench.send()
    solver = Peer(
        "solver", bench.host.real_time() + 1e6, "a session", facts={"work_left": "1"}, run_id=""
    )
    bench.host.watch.heard("/solver", solver)
    bench.state, bench.text = State.FINISHED, "all lines are measured"
    waits = "all lines are measured; waiting for the last results (solver)"
    bench.spin(lambda: bench.feedback and bench.feedback[-1].text == waits)
    assert not answer.done()
    assert len(bench.get(handle.cancel_goal_async()).goals_canceling) == 1
    response = bench.get(answer)
    assert response.status == CANCELED and response.result.outcome == FINISHED_OUTCOME
    assert bench.reasons == []


UNHEARD = "cannot start: there is no recorder node"


def test_a_goal_waits_for_nodes_that_are_starting(bench):
    bench.unheard = UNHEARD
    _, answer = bench.send("quick")
    bench.spin(lambda: bench.feedback)
    told = bench.feedback[0]
    assert told.run_id == "" and told.stops_total == 0 and math.isnan(told.remaining_time)
    most = f"for {PATIENCE:g} s at most"
    assert told.text == f"waiting for nodes that may be starting, {most}: {UNHEARD}"
    # No other goal overtakes it, and nothing has begun.
    other = bench.get(bench.send("demo")[1]).result
    assert other.outcome == REFUSED_OUTCOME and "another goal waits for the nodes" in other.text
    assert bench.plans == [] and not answer.done()
    bench.unheard = ""
    bench.spin(lambda: bench.plans)
    bench.spin(lambda: bench.feedback[-1].run_id == "run 1")
    bench.state = State.FINISHED
    response = bench.get(answer)
    assert response.status == SUCCEEDED and bench.plans == ["quick"]
    # What it waited for is told once, not at every look.
    assert [one.text for one in bench.feedback].count(told.text) == 1


def test_a_goal_does_not_wait_longer_than_it_says(bench, monkeypatch):
    monkeypatch.setattr("stepdiag_ros.nodes.measure_action.START_PATIENCE", 0.3)
    bench.unheard = UNHEARD
    response = bench.get(bench.send()[1])
    assert response.status == ABORTED and response.result.outcome == REFUSED_OUTCOME
    assert response.result.text == UNHEARD and bench.feedback
    # A refusal that cannot pass ends a goal that waits too.
    monkeypatch.setattr("stepdiag_ros.nodes.measure_action.START_PATIENCE", 3600.0)
    _, answer = bench.send()
    bench.spin(lambda: len(bench.feedback) == 2)
    bench.refusal = "cannot start: recorder: the disk is full"
    assert bench.get(answer).result.text == bench.refusal
    assert bench.plans == []


@pytest.mark.parametrize("who", ["client", "operator"])
def test_a_goal_that_was_given_up_while_it_waited_never_begins(bench, who):
    bench.unheard = UNHEARD
    handle, answer = bench.send()
    bench.spin(lambda: bench.feedback)
    if who == "client":
        assert len(bench.get(handle.cancel_goal_async()).goals_canceling) == 1
        said = "cancelled by the client that requested the run, before it began"
    else:
        assert bench.action.give_up("aborted by the operator")
        said = "aborted by the operator, before it began"
    bench.unheard = ""
    response = bench.get(answer)
    assert response.status == (CANCELED if who == "client" else ABORTED)
    assert response.result.outcome == REFUSED_OUTCOME and response.result.text == said
    assert bench.plans == [] and bench.reasons == [] and not bench.action.give_up("")


def parameter_is_refused(cell, value):
    """Set the sequencer's plan as ros2 param set does; return the reason, empty if it was taken."""
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter

    operator = cell.operator
    client = operator.create_client(SetParameters, "sequencer/set_parameters")
    assert operator.spin_until(client.service_is_ready, PATIENCE)
    request = SetParameters.Request(parameters=[Parameter("plan", value=value).to_parameter_msg()])
    future = client.call_async(request)
    assert operator.spin_until(future.done, PATIENCE)
    (result,) = future.result().results
    assert result.successful is not bool(result.reason)
    return result.reason


def followed(cell):
    """Return a list to which each RunState is added that is said from now on."""
    from stepdiag_ros import topics

    states = []
    cell.operator.listen(topics.RUN_STATE, states.append)
    return states


def start_client(*arguments):
    command = [sys.executable, "-m", "stepdiag_ros.cli", "measure", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for_stops_of(cell, client, count):
    def there():
        assert client.poll() is None, client.communicate()[1]
        return len(cell.stops) > count

    cell.wait(there, "stops of the run of the client")


def test_runs_by_action_in_a_cell(make_cell, tmp_path):
    text = load_plan("demo")[1]
    with make_cell() as cell:
        operator, states = cell.operator, followed(cell)
        for plan, names in (
            ("nonsense", ["nonsense"]),
            ("{name: short}", ["step_m"]),
            (text.replace("step_m: [0", "step_m: [1"), ["X"]),
        ):
            with refused(Refusal, "rejected", *names):
                operator.start(plan)
        assert not cell.statuses, "a refused goal has moved the machine"

        run_id = cell.start(text)
        cell.wait(lambda: len(cell.stops) >= 5, "five stops")
        # Not the plan of the parameter, but the one of the goal.
        lines = len(load_plan("demo")[0].lines)
        assert operator.state.line_count == lines
        with refused(Refusal, "rejected"):
            operator.start()
        assert "between runs only" in parameter_is_refused(cell, "demo")
        operator.call("sequencer/pause")
        cell.wait_for_state(State.PAUSED)
        operator.call("sequencer/resume")
        count = len(cell.stops)
        cell.wait(lambda: len(cell.stops) > count + 1, "more stops after resume")
        assert operator.started_run == run_id and operator.result is None
        operator.cancel()
        cell.wait_for_state(State.ABORTED)
        cell.stands_still_after(operator.state)
        cell.wait(lambda: operator.result is not None, "the result")
        result = operator.result
        assert result.outcome == ABORTED_OUTCOME and "cancelled" in result.text
        assert result.run_id == run_id and run_id in result.bag and result.bag_closed
        assert 5 <= result.stops_done < result.stops_total
        with refused(Refusal, "stopped"):
            operator.cancel()

        assert "there is no plan 'nonsense'" in parameter_is_refused(cell, "nonsense")
        far = tmp_path / "far.yaml"
        far.write_text(text.replace("step_m: [0", "step_m: [1"))
        assert "outside the soft limits" in parameter_is_refused(cell, str(far))
        assert parameter_is_refused(cell, "demo") == ""

        # A client of its own, as people use it; the run takes the plan that was set just now.
        stops = len(cell.stops)
        client = start_client()
        wait_for_stops_of(cell, client, stops + 2)
        assert {message.line_count for message in states[-1:]} == {lines}
        client.send_signal(signal.SIGINT)
        operator.spin_until(lambda: client.poll() is not None, PATIENCE)
        out, err = client.communicate(timeout=PATIENCE)
        assert client.returncode == 130, err
        assert "cancelled by the client that requested the run" in out and "(closed, " in out
        cell.wait(lambda: states[-1].state == State.ABORTED, "the run of the client is aborted")
        cell.stands_still_after(states[-1])


def test_a_whole_run_on_nodes_that_are_there(make_cell, tmp_path):
    plan = tmp_path / "only_here.yaml"
    text = load_plan("quick")[1]
    plan.write_text(text.replace("pause_for_setup: false", "pause_for_setup: true"))
    with make_cell(plan="demo", factor=40.0) as cell:
        states = followed(cell)
        client = start_client("--json", "--plan", str(plan))

        def ended():
            if states and states[-1].state == State.WAITING_FOR_SETUP:
                if states[-1].line_index == 0:
                    # Time for the client to say what is to be done.
                    cell.operator.spin_until(lambda: False, 1.0)
                # The one who has just resumed may hear once more that the run waits.
                with contextlib.suppress(ValueError):
                    cell.operator.call("sequencer/resume")
                states.clear()
            return client.poll() is not None

        cell.wait(ended, "the client has ended")
        out, err = client.communicate(timeout=PATIENCE)
        assert client.returncode == 0, err

        # A client that vanishes changes nothing.
        stops = len(cell.stops)
        vanishing = start_client("--plan", "quick")
        wait_for_stops_of(cell, vanishing, stops + 2)
        vanishing.kill()
        vanishing.communicate(timeout=PATIENCE)
        cell.wait(lambda: len(cell.stops) > stops + 5, "the run goes on")
        cell.operator.call("sequencer/abort")
    assert "align laser and mirror" in err and "sequencer/resume goes on" in err
    document = json.loads(out)
    assert document["outcome"] == "finished" and document["text"] == "all lines are measured"
    assert document["stops_done"] == document["stops_total"] > 40 and document["incomplete"] == []
    assert document["verdict"] == "NOT TESTABLE" and document["sentence"]
    assert document["bag_closed"] and document["bag_text"].startswith("closed, ")
    assert Path(document["bag"]).stat().st_size > 10_000 and document["run_id"] in document["bag"]


def test_the_plan_of_the_sequencer_is_warned_of_as_well(make_cell, tmp_path):
    plan = tmp_path / "four.yaml"
    plan.write_text(
        "name: four\nstep_m: [0.03, 0.03, 0.03]\nblocks: 2\nfeed_m_per_s: 0.05\n"
        "pause_for_setup: false\n"
        "lines:\n  - {kind: step_diagonal, names: [ppp, npp, pnp, ppn]}\n"
    )
    with make_cell(plan=str(plan), factor=20.0) as cell:
        client = start_client("--json")
        cell.wait(lambda: client.poll() is not None, "the client has ended")
        out, err = client.communicate(timeout=PATIENCE)
    assert client.returncode == 0, err
    assert "warning" in err and all(name in err for name in ("E_XX", "E_YY", "E_ZZ"))
    first = json.loads(out)["lead"]
    assert first["passes"]["planned"] == first["passes"]["complete"] and first["solved"] is None
    assert next(one["command"].split()[1] for one in first["next"] if one["command"]) == "solve"


@pytest.mark.parametrize("command", ["measure --plan quick", "pause", "resume", "abort"])
def test_without_nodes_there_is_nothing_to_measure_on(command, monkeypatch, capsys):
    monkeypatch.setattr("stepdiag_ros.processes.joining.LOOK_LIMIT", 0.3)
    assert main([*command.split(), "--namespace", "/cell_1"]) == 1
    out, said = capsys.readouterr()
    assert not out
    assert "there is no sequencer in namespace /cell_1 on ROS domain" in said
    assert "Traceback" not in said
