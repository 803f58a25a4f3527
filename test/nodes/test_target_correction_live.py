"""Target correction by the bridge in the simulated cell: whole runs, judged by the truth."""

import numpy as np
import pytest
from closed_loop import compensate, files_of, stood
from domains import room_for_a_cell
from refused import refused

from stepdiag_ros.commands.solve import report_of
from stepdiag_ros.processes.cell import simulated_cell
from stepdiag_ros.processes.following import RunFailed
from stepdiag_ros.processes.measure import MeasuringSession

FACTOR = 4.0


def measured(folder, **bridge):
    plan, cell = files_of(folder)
    nodes = simulated_cell(str(plan), "demo", str(cell), folder, FACTOR, 0.0, 1)
    nodes = [node for node in nodes if node.name not in ("diagnosis", "evaluator")]
    for node in nodes:
        if node.name == "bridge":
            node.parameters.update(bridge)
    with room_for_a_cell():
        return MeasuringSession(nodes, folder, lambda _: None).measure()


@pytest.fixture(scope="module")
def before(tmp_path_factory):
    folder = tmp_path_factory.mktemp("correction")
    bag = measured(folder / "before")
    return bag, compensate(bag, "generic", folder / "map") / "volumetric_map.json"


def test_with_targets_corrected_the_volume_is_twenty_times_better(before, tmp_path):
    bag, error_map = before
    after = stood(measured(tmp_path / "after", correction=str(error_map)))
    first = stood(bag)
    assert first.volume() > 3e-6
    assert first.volume() / after.volume() > 20.0
    # Commands stay what the plan asks for; the positions are those of the controller.
    assert np.array_equal(first.target, after.target)
    assert np.max(np.abs(after.told - after.target)) > 3e-6
    said = [one.message for one in after.run.diagnostics if "target correction" in one.name]
    assert any("targets are corrected by volumetric_map.json (SHA-256" in text for text in said)
    remarks = report_of(after.run.path).remarks
    assert any("in this run targets are corrected by volumetric_map.json" in one for one in remarks)
    said = [one.message for one in first.run.diagnostics if "target correction" in one.name]
    assert set(said) <= {"targets are not corrected"} | {t for t in said if "not in use" in t}


def test_a_correction_beyond_its_limit_moves_nothing(before, tmp_path):
    _, error_map = before
    with refused(RunFailed, None, "correction_limit", "1"):
        measured(tmp_path / "limited", correction=str(error_map), correction_limit=1e-6)
