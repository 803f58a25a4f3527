"""The diagnosis node alone: it says what the lines so far tell, and at the end what they all do."""

import time
from pathlib import Path

import rclpy
import yaml
from patience import PATIENCE

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.bags.header import RunHeader
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.cli import make_parser
from stepdiag_ros.commands.diagnose import report_of
from stepdiag_ros.configuration import load_cell, load_machine, load_model, load_plan
from stepdiag_ros.evaluation.diagnosing import Reference, summary_of, when_over
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.diagnosis import from_diagnosis, to_diagnosis
from stepdiag_ros.messages.fields import set_header, to_nanoseconds
from stepdiag_ros.metrology.discrepancy.summary import NOT_DIAGNOSED
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.solvers.limits import MOST_VALUES
from stepdiag_ros.run.sequence import State

RUN_ID = "20260102T030405-abcd"
TYPE = topics.DIAGNOSIS.type_name
KNOWN_BACKLASH = """\
name: mill with a known backlash
chain: {chain}
curves: free
effects:
  - effect: backlash
    setting: {{axis: X}}
    sizes: {{lost_motion: 8.0e-7}}
    standard_uncertainty: {{lost_motion: 2.0e-8}}
    status: fitted
"""


def described(plan_text, machine_text):
    description = conversion.new_message(topics.RUN_DESCRIPTION.type_name)
    set_header(description, 1)
    description.run_id, description.plan, description.machine = RUN_ID, plan_text, machine_text
    description.schema_version = description.SCHEMA_VERSION
    return description


def recorded(path, description, lines):
    """Write the bag of a run whose lines were measured like this."""
    types = own_types()
    header = RunHeader(
        RUN_ID, "plan", "0.1.0", 1, "none", 1, description.plan, description.machine, ""
    )
    with BagWriter(path, header) as bag:
        for topic, message in [
            (topics.RUN_DESCRIPTION, description),
            *((topics.LINE, conversion.from_measured_line(line, RUN_ID)) for line in lines),
        ]:
            data = types.encode(topic.type_name, message)
            bag.write(topics.absolute(topic), topic.type_name, data, 1)
    return path


def command_says(bag):
    """Return the report of ``stepdiag diagnose`` for a bag."""
    return report_of(make_parser().parse_args(["diagnose", str(bag), "--seed", "3"]))


class Bench:
    """A diagnosis node in a process, and a test that plays the rest of the system."""

    def __init__(self, folder: Path, **parameters: object) -> None:
        from stepdiag_ros.nodes.operator import OperatorNode
        from stepdiag_ros.processes.node_process import NodeProcess, Processes

        self.processes = Processes([NodeProcess("diagnosis", parameters)], folder / "logs")
        rclpy.init(args=[])
        self.operator = OperatorNode()
        self.heard = []
        self.operator.listen(topics.DIAGNOSIS, self.heard.append)
        self.describe = self.operator.announce(topics.RUN_DESCRIPTION)
        self.tell = self.operator.announce(topics.LINE)
        self.state = self.operator.announce(topics.RUN_STATE)

    def __enter__(self) -> "Bench":
        self.processes.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self.processes.end()
        self.operator.destroy_node()
        rclpy.try_shutdown()

    @property
    def peer(self):
        peers = self.operator.watch.peers.values()
        return next((peer for peer in peers if peer.role == "diagnosis"), None)

    def publish_lines(self, lines):
        for line in lines:
            self.tell.publish(conversion.from_measured_line(line, RUN_ID))

    def end_run(self):
        state = conversion.new_message(topics.RUN_STATE.type_name)
        state.run_id, state.state = RUN_ID, state.STATE_FINISHED
        self.state.publish(state)

    def wait(self, condition, limit=PATIENCE):
        assert self.operator.spin_until(condition, limit), [
            log.read_text()[-2000:] for log in self.processes._logs.glob("*.log")
        ]


def test_the_node_names_what_is_hidden_as_the_command_does(tmp_path):
    plan, plan_text = load_plan("demo")
    machine_text = load_machine("demo")[1]
    lines = simulate(plan, load_cell("hidden_backlash")[0], seed=1).lines
    description = described(plan_text, machine_text)
    with Bench(tmp_path, seed=3, pause_s=0.0) as bench:
        # The description last: lines that come before it must not be lost.
        bench.publish_lines(lines[:1])
        bench.describe.publish(description)
        bench.wait(lambda: bool(bench.heard))
        first = to_diagnosis(bench.heard[0])
        assert (first.verdict, first.lines, first.run_over) == ("NOT TESTABLE", 1, False)
        assert "27 of the plan's 28 lines are not among them: x, y, z, ppp" in first.remarks[0]
        bench.publish_lines(lines[1:])
        bench.wait(lambda: bench.heard[-1].lines == len(lines))
        assert not bench.heard[-1].run_over
        bench.end_run()
        bench.wait(lambda: bench.heard[-1].run_over)
        # Lines that come while one diagnosis is made are taken up together by the next.
        assert len(bench.heard) < len(lines)
        bench.wait(lambda: bench.peer is not None and bench.peer.facts["work_left"] == "0")
        assert bench.peer.facts["verdict"] == to_diagnosis(bench.heard[-1]).words
        last = bench.heard[-1]
    diagnosis = to_diagnosis(last)
    assert diagnosis.verdict == "NAMED"
    (found,) = diagnosis.findings
    assert (found.label, found.setting) == ("backlash of X", {"axis": "X"})
    assert to_nanoseconds(last.header.stamp) == max(line.end_time for line in lines)

    report = command_says(recorded(tmp_path / "run.mcap", description, lines))
    reference = Reference.from_text(load_model("free")[1], "free", 3)
    measurement = simulate(plan, load_cell("hidden_backlash")[0], seed=1)
    expected = when_over(summary_of(report.diagnosis, measurement, reference, plan))
    assert own_types().encode(TYPE, last) == own_types().encode(
        TYPE, from_diagnosis(expected, RUN_ID)
    )


def test_a_model_is_heeded_and_one_of_another_machine_is_refused_in_words(tmp_path):
    plan, plan_text = load_plan("demo")
    lines = simulate(plan, load_cell("hidden_backlash")[0], seed=1).lines
    model = tmp_path / "mill.yaml"
    model.write_text(KNOWN_BACKLASH.format(chain="YXZ"))
    machine_text = load_machine("demo")[1]
    with Bench(tmp_path, model=model) as bench:
        other = described(plan_text, machine_text.replace("chain: YXZ", "chain: XYZ"))
        assert "chain: XYZ" in other.machine
        bench.describe.publish(other)
        bench.wait(lambda: bench.peer is not None and bench.peer.faulty)
        assert "the chain XYZ, the model of one with YXZ" in bench.peer.text
        bench.describe.publish(described(plan_text, machine_text))
        bench.publish_lines(lines)
        bench.wait(lambda: bench.peer.run_id == RUN_ID and not bench.peer.faulty)
        bench.end_run()
        # The end of the run may come before its last lines: they have another topic.
        bench.wait(
            lambda: any(one.run_over and one.lines == len(lines) for one in bench.heard[-1:])
        )
        last = to_diagnosis(bench.heard[-1])
    assert last.verdict == "CONSISTENT"
    assert last.model.name == "mill with a known backlash"
    assert last.model.text == model.read_text()


def test_while_a_run_goes_on_the_node_rests_between_two_diagnoses(tmp_path):
    plan, plan_text = load_plan("quick")
    lines = simulate(plan, load_cell("demo")[0], seed=1).lines
    with Bench(tmp_path, pause_s=3600.0) as bench:
        bench.describe.publish(described(plan_text, load_machine("demo")[1]))
        bench.publish_lines(lines[:1])
        bench.wait(lambda: len(bench.heard) == 1)
        bench.publish_lines(lines[1:])
        bench.wait(lambda: bench.peer.facts["work_left"] == "1")
        bench.operator.spin_until(lambda: len(bench.heard) > 1, 1.0)
        assert len(bench.heard) == 1
        # Long before the pause is over.
        bench.end_run()
        bench.wait(lambda: len(bench.heard) == 2)
    assert (bench.heard[1].lines, bench.heard[1].run_over) == (len(lines), True)


def test_a_run_goes_on_without_the_node_which_catches_up_when_it_is_back(make_cell):
    with make_cell() as cell:
        heard = []
        cell.operator.listen(topics.DIAGNOSIS, heard.append)
        cell.start()
        cell.wait(lambda: len(cell.lines) >= 2, "two lines")
        cell.kill("diagnosis")
        cell.wait(lambda: len(cell.lines) >= 4, "the run goes on")
        assert cell.state() == State.RUNNING
        cell.operator.call("sequencer/pause")
        killed = time.monotonic()
        cell.restart("diagnosis")
        cell.wait(lambda: bool(cell.said_since("diagnosis", killed)), "it is back")
        cell.operator.call("sequencer/resume")
        cell.wait_for_state(State.FINISHED)
        cell.wait(lambda: bool(heard) and heard[-1].run_over, "the last diagnosis")
        assert heard[-1].lines == len(cell.lines) == heard[-1].lines_planned
        cell.wait(cell.bag_is_closed, "the bag is closed")
    (bag,) = cell.folder.glob("*.mcap")
    run = load_run(bag)
    assert run.diagnoses[-1].run_over
    assert run.diagnoses[-1].lines == len(run.plan.lines)


def test_lines_that_cannot_be_diagnosed_are_said_and_the_node_goes_on(tmp_path):
    plan, plan_text = load_plan("quick")
    lines = simulate(plan, load_cell("demo")[0], seed=1).lines
    model = tmp_path / "wrong.yaml"
    model.write_text("name: wrong\nchain: unknown\ncurves: {E_XX: [0.0, 1.0e-6]}\neffects: []\n")
    with Bench(tmp_path, model=model) as bench:
        bench.describe.publish(described(plan_text, load_machine("demo")[1]))
        bench.publish_lines(lines)
        bench.end_run()
        bench.wait(lambda: bench.peer is not None and bench.peer.faulty)
        assert "the lines cannot be diagnosed: E_XX: 2 values are given" in bench.peer.text
        bench.wait(lambda: bench.peer.facts["work_left"] == "0")
        assert not bench.heard
        assert not bench.processes.ended()


def test_a_run_that_is_too_large_is_said_before_its_first_line_and_not_diagnosed(tmp_path):
    wanted = {
        "step_m": [0.001] * 3,
        "blocks": MOST_VALUES // 9,
        "feed_m_per_s": 0.05,
        "lines": [{"kind": "linear", "names": ["x", "y", "z"]}],
    }
    plan = Plan.from_mapping(wanted, "test plan")
    lines = simulate(plan, load_cell("demo")[0], seed=1).lines
    with Bench(tmp_path) as bench:
        bench.describe.publish(described(yaml.safe_dump(wanted), load_machine("demo")[1]))
        bench.wait(lambda: bench.peer is not None and "verdict" in bench.peer.facts)
        said = bench.peer.facts["verdict"]
        assert said.startswith(NOT_DIAGNOSED) and str(plan.volume.blocks) in said
        bench.publish_lines(lines)
        bench.end_run()
        bench.wait(lambda: "ended" in bench.peer.text)
        assert bench.peer.facts["work_left"] == "0" and not bench.peer.faulty
        assert not bench.heard and not bench.processes.ended()
