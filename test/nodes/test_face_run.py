"""Step diagonals of a face on the node graph: two axes, one at a time; the third never moves."""

import numpy as np
import pytest

from stepdiag_ros.bags.run import load_run
from stepdiag_ros.evaluation.recorded_run import report_of_run
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.plan import STEP_DIAGONAL
from stepdiag_ros.run.sequence import State

PLAN = """
name: small face
origin_m: [0.0, 0.01, 0.0]
step_m: [0.02, 0.02, 0.015]
blocks: 2
directions: [forward, backward]
feed_m_per_s: 0.1
pause_for_setup: false
lines:
  - {kind: linear, names: [x, z]}
  - {kind: step_diagonal, names: [p0p, n0p], orders: [XZ, ZX]}
sampling: {dwell_s: 0.1, settle_s: 0.1, window_s: 0.1}
"""


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "face.yaml"
    path.write_text(PLAN)
    return path


def test_a_face_on_the_node_graph(make_cell, plan_file):
    with make_cell(plan=str(plan_file), factor=20.0) as cell:
        cell.start()
        cell.wait_for_state(State.FINISHED)
        cell.wait(cell.bag_is_closed, "the bag is closed")
        (bag,) = cell.folder.glob("*.mcap")

    run = load_run(bag)
    assert [str(line.line) for line in run.lines] == [str(line) for line in run.plan.lines]
    assert all(line.complete for line in run.lines)
    assert np.ptp([stop.command.target[1] for stop in run.stops]) == 0.0
    again = assemble(run.plan, run.start_time, run.commands, run.arrivals, run.readings())
    blocks = [event for event in again if type(event) is type(run.blocks[0])]
    assert blocks == list(run.blocks)
    stepped = [block for block in blocks if block.line.kind == STEP_DIAGONAL]
    # Eight passes, two blocks of two moves each.
    assert len(stepped) == 8 * 2 * 2
    assert {block.axis for block in stepped} == {"X", "Z"}

    report = report_of_run(run)
    assert all(report.equals_recorded[method] for method in ("setup_robust", "least_squares"))
    for result in report.results:
        if result.method not in ("setup_robust", "least_squares"):
            continue
        for name in ("E_XX", "E_ZX", "E_XZ", "E_ZZ"):
            np.testing.assert_allclose(result.curves[name], report.truth.curves[name], atol=0.3e-6)
        assert np.all(np.isnan(result.curves["E_YY"][1:]))
