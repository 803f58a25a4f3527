"""A seven-line test with a tracker on the node graph, and its replay to the last bit."""

import numpy as np
import pytest

from stepdiag_ros.bags.run import load_run
from stepdiag_ros.configuration import load_tracker
from stepdiag_ros.evaluation.tracker import reports_of_run
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.joint import NAMES
from stepdiag_ros.metrology.tracker.measured_lines import plan_of
from stepdiag_ros.metrology.tracker.seven_lines import make_test
from stepdiag_ros.planning.plan_text import plan_text
from stepdiag_ros.run.sequence import State

STATION = np.array([-0.15, 0.15, -0.15])


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    tracker, box = load_tracker("demo")[0], Box(np.zeros(3), np.full(3, 0.12))
    test = make_test(box, STATION, tracker, targets=5, runs=1, locating=8)
    plan = plan_of(
        *(test.readings("1"), {"1": STATION}, tracker, box),
        name="seven lines",
        feed=0.2,
        overrun=2e-3,
    )
    path = tmp_path_factory.mktemp("plan") / "tracker.yaml"
    text = plan_text(plan).replace("pause_for_setup: true", "pause_for_setup: false")
    path.write_text(text, encoding="utf-8")
    return path


def test_seven_lines_on_the_node_graph(make_cell, plan_file):
    with make_cell(plan=str(plan_file), factor=20.0) as cell:
        cell.start()
        cell.wait_for_state(State.FINISHED)
        cell.wait(cell.bag_is_closed, "the bag is closed")
        (bag,) = cell.folder.glob("*.mcap")

    run = load_run(bag)
    assert [str(line.line) for line in run.lines] == [str(line) for line in run.plan.lines]
    assert all(line.complete for line in run.lines)
    again = assemble(run.plan, run.start_time, run.commands, run.arrivals, run.readings())
    lines = [event for event in again if isinstance(event, MeasuredLine)]
    for assembled, recorded in zip(lines, run.lines, strict=True):
        assert np.array_equal(assembled.displacement, recorded.displacement)

    (report,) = reports_of_run(run)
    assert report.equals_recorded is True
    assert report.verdict.name == "CONSISTENT"
    assert {test.name for test in run.tests} == {
        test.name for test in (report.result.corrected or report.result.located).tests
    }
    last = run.diagnoses[-1]
    assert (last.verdict, last.run_over) == ("CONSISTENT", True)
    joint = report.result.joint
    away = np.abs(joint.values - report.truth) / joint.standard_uncertainty
    assert dict(zip(NAMES, away < 3.0, strict=True)) == dict.fromkeys(NAMES, True)
