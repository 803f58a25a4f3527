"""Bags of every schema version stay readable for ever: one of each lies in ``test/data/bags``.

``schema_1.mcap`` holds one message of everything; what it says is written down here.
"""

from pathlib import Path

import numpy as np
import pytest

from stepdiag_ros import topics
from stepdiag_ros.bags.info import bag_info
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.messages.samples import to_sample_block

BAGS = Path(__file__).parent.parent / "data" / "bags"
VERSIONS = range(1, own_types().constant("stepdiag_ros/msg/RunDescription", "SCHEMA_VERSION") + 1)


@pytest.mark.parametrize("version", VERSIONS)
def test_there_is_a_bag_of_every_version(version):
    run = load_run(BAGS / f"schema_{version}.mcap")
    assert run.schema_version == version
    with BagReader(run.path) as bag:
        assert {topics.absolute(topic) for topic in topics.RECORDED} == set(bag.topics)
        assert sum(1 for _ in bag.messages()) >= len(topics.RECORDED)


def test_a_bag_from_before_overruns_and_diagnoses_were_recorded_is_read():
    run = load_run(BAGS / "schema_1_before_overrun.mcap")
    (line,) = run.lines
    assert line.overrun == 0.0
    assert line.displacement.tolist() == [0.0, 0.0100005, 0.0200006]
    assert run.diagnoses == ()


def test_a_bag_from_before_samples_and_triggers_were_recorded_is_read():
    run = load_run(BAGS / "schema_1_before_samples.mcap")
    (reading,) = run.readings()
    assert (reading.trigger, reading.compensated_displacement) == (0, 0.0100002)
    assert bag_info(run.path).samples == {}


def test_a_bag_from_before_verdicts_were_recorded_is_read():
    run = load_run(BAGS / "schema_1_before_verdict.mcap")
    assert [one.verdict for one in run.diagnoses] == ["AMBIGUOUS"]


def test_the_verdict_of_version_1_says_what_it_said():
    with BagReader(BAGS / "schema_1.mcap") as bag:
        ((_, message),) = bag.messages(topics={topics.absolute(topics.RUN_VERDICT)})
    assert message.run_over and (message.conformity, message.diagnosis) == (1, 3)
    # Verdicts did not yet state how the run had ended.
    assert not hasattr(message, "outcome")
    assert (message.worst_error, message.expanded_uncertainty) == (7.3e-6, 1.0e-6)
    assert (message.coverage_factor, message.tolerance) == (1.96, 2e-5)
    assert list(message.worst_place) == [0.03, 0.06, 0.1]
    assert (message.method, list(message.not_determined)) == ("least_squares", ["E_XX"])


def test_samples_of_version_1_say_what_they_said():
    with BagReader(BAGS / "schema_1.mcap") as bag:
        ((_, message),) = bag.messages(topics={topics.absolute(topics.SAMPLES)})
    assert message.decimation == 50
    block = to_sample_block(message)
    assert (block.sequence, block.period, block.zero, len(block)) == (50, 2e-5, 3, 3)
    assert (block.scale, block.offset) == (0.99973, 1.5e-7)
    assert block.raw_displacement.tolist() == [0.01, 0.0100001, 0.0100002]
    assert block.signal_strength.tolist() == np.float32([0.9, 0.8, 0.7]).tolist()
    assert block.status.tolist() == [0, 0, 1]
    assert block.environment == (20.0, 101325.0, 0.5, 20.5)


def test_version_1_says_what_it_said():
    run = load_run(BAGS / "schema_1.mcap")
    assert run.run_id == "20260101-000000-abcd"
    assert run.chain == "YXZ"
    assert (run.volume.step, run.volume.blocks) == ((0.01, 0.02, 0.03), 2)
    assert [command.command_id for command in run.commands] == [1]
    assert run.commands[0].target == (0.01, 0.0, 0.0)
    assert run.arrivals[0].position == (0.0100001, 0.0, 0.0)
    assert next(run.readings()).compensated_displacement == 0.0100002
    assert next(run.readings()).trigger == 7
    (stop,) = run.stops
    assert (stop.settled, stop.displacement, stop.readings) == (True, 0.0100003, 300)
    (block,) = run.blocks
    assert (block.axis, block.displacement) == ("X", 0.0100004)
    (line,) = run.lines
    assert line.line.offset == (0.0, 0.02, 0.0)
    assert line.overrun == 0.002
    assert line.displacement.tolist() == [0.0, 0.0100005, 0.0200006]
    (result,) = run.results
    assert result.method == "least_squares"
    assert result.curves["E_ZY"].tolist() == [0.0, 1.25e-6, 2.5e-6]
    assert np.isnan(result.curves["E_XX"]).all()
    assert result.figure("C0Y").value == -1.5e-6
    (test,) = run.tests
    assert (test.standard, test.name, test.runs) == ("ISO 230-2", "X", (2, 1))
    assert test.mean_backward.tolist() == [0.5e-6, 1.0e-6, 3.5e-6]
    assert test.parameters["E"] == 3.5e-6
    assert np.isnan(test.parameters["R"])
    (diagnosis,) = run.diagnoses
    assert (diagnosis.verdict, diagnosis.run_over, diagnosis.seed) == ("AMBIGUOUS", True, 7)
    (found,) = diagnosis.findings
    assert (found.label, found.setting) == ("backlash of X", {"axis": "X"})
    assert (found.sizes[0].value, found.sizes[0].band) == (8e-7, (7.8e-7, 8.2e-7))
    assert diagnosis.covariance == (1e-16,)
    assert [other.ambiguous for other in found.runners_up] == [True, False]
    assert diagnosis.map[0].rms == 2e-7
    assert diagnosis.detection_limits[0].smallest == 6e-8
    assert (diagnosis.before.chi_squared, diagnosis.before.degrees_of_freedom) == (150.5, 100)
    assert np.isnan(diagnosis.after.p_value)
    assert diagnosis.model.text == "name: by hand\n"
    assert [state.text for state in run.states] == ["finished"]
    assert [diagnostic.message for diagnostic in run.diagnostics] == ["ok"]
