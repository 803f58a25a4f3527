"""The evaluator alone: it says what each test gives when its last pass is there, and not before."""

from pathlib import Path

import rclpy
from patience import PATIENCE

import stepdiag_ros.client  # noqa: F401 - makes rclpy importable
from stepdiag_ros import topics
from stepdiag_ros.configuration import plan_from_text
from stepdiag_ros.evaluation.positioning import same_test
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.messages.positioning import to_positioning_test
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.standards.axis_test import all_runs
from stepdiag_ros.metrology.standards.iso230_2 import evaluate

RUN_ID = "20260102T030405-abcd"
PLAN = """\
name: two tests
step_m: [0.01, 0.01, 0.01]
blocks: 3
repeats: 2
directions: [forward, backward]
overrun_m: 0.001
feed_m_per_s: 0.05
lines:
  - {kind: diagonal, names: [npp]}
  - {kind: linear, names: [y]}
"""


def test_the_evaluator_publishes_each_test_when_it_is_complete(tmp_path: Path):
    from stepdiag_ros.configuration import load_cell
    from stepdiag_ros.nodes.operator import OperatorNode
    from stepdiag_ros.processes.node_process import NodeProcess, Processes

    plan = plan_from_text(PLAN, "test plan")
    measurement = simulate(plan, load_cell("demo")[0])
    rclpy.init(args=[])
    operator = OperatorNode()
    heard = []
    operator.listen(topics.POSITIONING_TEST, heard.append)
    describe = operator.announce(topics.RUN_DESCRIPTION)
    tell = operator.announce(topics.LINE)
    try:
        with Processes([NodeProcess("evaluator", {})], tmp_path):
            # The description last: lines that come before it must not be lost.
            for line in measurement.lines[:3]:
                tell.publish(conversion.from_measured_line(line, RUN_ID))
            description = conversion.new_message(topics.RUN_DESCRIPTION.type_name)
            description.run_id, description.plan = RUN_ID, PLAN
            describe.publish(description)
            peers = operator.watch.peers
            assert operator.spin_until(
                lambda: any(p.role == "evaluator" and p.run_id == RUN_ID for p in peers.values()),
                PATIENCE,
            )
            operator.spin_until(lambda: bool(heard), 0.5)
            assert not heard
            for line in measurement.lines[3:]:
                tell.publish(conversion.from_measured_line(line, RUN_ID))
            assert operator.spin_until(lambda: len(heard) == 2, PATIENCE)
    finally:
        operator.destroy_node()
        rclpy.try_shutdown()
    expected = [evaluate(runs) for runs in all_runs(measurement)]
    for message, test, last in zip(heard, expected, (3, 7), strict=True):
        assert same_test(to_positioning_test(message), test)
        assert message.run_id == RUN_ID
        assert message.standard == test.standard
        end_time = measurement.lines[last].end_time
        assert to_nanoseconds(message.header.stamp) == end_time
