"""The closed loop on a real controller: measure, solve, write tables, restart, measure again.

The machine is LinuxCNC with lagging drives; its imperfect twin, which only the laser sees, is fed
with the positions of the motors (``closed_loop``).
"""

import json
from pathlib import Path

import numpy as np
import pytest
from closed_loop import compensate, files_of, stood

from stepdiag_ros.processes.cell import twin_cell
from stepdiag_ros.processes.measure import MeasuringSession


def measured(machine, folder: Path, whole: bool = True, **bridge) -> Path:
    """Measure on a LinuxCNC that runs, with the twin behind it; return the bag."""
    plan, cell = files_of(folder, whole)
    device = folder / "device.yaml"
    # A computer that is busy with all nodes at once is no danger to this machine.
    device.write_text(f"socket: {machine.socket}\ndead_man_s: 2.0\nsilence_s: 20.0\n")
    nodes = twin_cell(str(plan), "demo", str(cell), folder, "linuxcnc", str(device))
    # What evaluates along the way is of no use here.
    nodes = [node for node in nodes if node.name not in ("diagnosis", "evaluator")]
    for node in nodes:
        if node.name == "bridge":
            node.parameters.update(bridge, position_rate=50.0, silence_limit=2.0)
    return MeasuringSession(nodes, folder, lambda _: None).measure()


@pytest.fixture(scope="module")
def loop(make_instance, tmp_path_factory):
    """Measure a machine, write its tables and its map, and measure it with each of them."""
    folder = tmp_path_factory.mktemp("loop")
    machine = make_instance()
    before = measured(machine, folder / "before")
    tables = compensate(before, "linuxcnc", folder / "tables")
    error_map = compensate(before, "generic", folder / "map") / "volumetric_map.json"
    corrected = measured(machine, folder / "corrected", correction=str(error_map))
    machine.stop()
    restarted = make_instance(
        tables={letter: tables / f"{letter.lower()}.comp" for letter in "XYZ"}
    )
    after = measured(restarted, folder / "after", whole=False)
    restarted.stop()
    return {
        "before": stood(before),
        "tables": stood(after),
        "correction": stood(corrected),
        "promised": json.loads((tables / "compensation.json").read_text()),
    }


def test_tables_make_positioning_fifty_times_better(loop, record_property):
    before, after = loop["before"].positioning(), loop["tables"].positioning()
    factors = [one / other for one, other in zip(before, after, strict=True)]
    record_property("positioning_before_um", [round(1e6 * value, 3) for value in before])
    record_property("positioning_after_um", [round(1e6 * value, 4) for value in after])
    print("positioning, µm:", [(1e6 * a, 1e6 * b) for a, b in zip(before, after, strict=True)])
    assert min(before) > 8e-6
    assert min(factors) >= 50.0, (before, after)
    # The motors really went elsewhere than they were told: it was LinuxCNC that compensated.
    moved = np.abs(loop["tables"].motors - loop["tables"].target)
    assert (
        np.max(moved) > 8e-6
        and np.max(np.abs(loop["before"].motors - loop["before"].target)) < 1e-7
    )


def test_target_correction_makes_the_volume_twenty_times_better(loop, record_property):
    before, after = loop["before"].volume(), loop["correction"].volume()
    record_property("volume_rms_um", [round(1e6 * before, 3), round(1e6 * after, 4)])
    print("volume rms, µm:", 1e6 * before, 1e6 * after)
    assert before > 3e-6
    assert before / after >= 20.0
    corrected = loop["correction"].run
    said = [one.message for one in corrected.diagnostics if "target correction" in one.name]
    assert any("targets are corrected by volumetric_map.json (SHA-256" in text for text in said)
    # Commands stay what the plan asks for; the positions are those of the controller.
    assert np.max(np.abs(loop["correction"].told - loop["correction"].target)) > 3e-6


def test_the_promise_beside_the_tables_was_kept(loop):
    promised = {one["name"]: one for one in loop["promised"]["changes"]}
    before, after = loop["before"].positioning(), loop["tables"].positioning()
    for axis, letter in enumerate("XYZ"):
        told = promised[f"positioning E_{letter}{letter}"]
        assert told["before"] == pytest.approx(before[axis], abs=0.05e-6)
        assert told["after"] < 0.01e-6 and after[axis] < 0.2e-6
