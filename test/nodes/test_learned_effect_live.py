"""A bend without a name in a whole cell: described, learned, compensated, measured again."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from closed_loop import BLOCKS, ORIGIN, PLAN, STEP, compensate, stood, twin

from stepdiag_ros.cli import main
from stepdiag_ros.metrology.discrepancy import CONSISTENT, DESCRIBED
from stepdiag_ros.processes.cell import simulated_cell
from stepdiag_ros.processes.measure import MeasuringSession

FACTOR = 8.0
SIZE = 4e-6
DIAGONALS = """\
  - kind: step_diagonal
    names: [ppp, npp, pnp, ppn]
    orders: [XYZ, YZX]
"""


def bend(places):
    """Return how far the tool is displaced along Y where X and Z are beyond the middle, m."""
    beyond = np.maximum(2.0 * (places - ORIGIN) / (STEP * BLOCKS) - 1.0, 0.0)
    moved = np.zeros_like(places)
    moved[:, 1] = SIZE * beyond[:, 0] * beyond[:, 2]
    return moved


def measured(folder, correction=""):
    folder.mkdir()
    plan, cell = folder / "plan.yaml", folder / "cell.yaml"
    text = PLAN.replace("DIAGONALS\n", DIAGONALS).replace("repeats: 1", "repeats: 2")
    # In one direction alone, a change of the reading with the sense of Y would look the same.
    plan.write_text(text.replace("[forward]", "[forward, backward]"))
    bent = {
        "effect": "learned shape",
        "setting": {"acts_on": "Y", "shape": "x>0.5 * z>0.5"},
        "sizes": {"amplitude": SIZE},
    }
    cell.write_text(yaml.safe_dump({**json.loads(twin()), "effects": [bent]}))
    nodes = simulated_cell(
        *(str(plan), "demo", str(cell), folder, FACTOR, 0.0, 1), correction=str(correction)
    )
    nodes = [node for node in nodes if node.name not in ("diagnosis", "evaluator")]
    return MeasuringSession(nodes, folder, lambda _: None).measure()


def verdict(bag, *more):
    folder = bag.parent / "diagnosis"
    options = ("--pictures", "none", "--output", str(folder))
    assert main(["diagnose", str(bag), *options, *map(str, more)]) == 0
    return json.loads((folder / "diagnosis.json").read_text())["verdict"]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bend")
    first, model = measured(folder / "first"), folder / "bent.yaml"
    assert verdict(first, "--extend", model) == DESCRIBED
    error_map = compensate(first, "generic", folder / "map", "--model", str(model))
    return first, measured(folder / "second", error_map / "volumetric_map.json")


def test_the_volume_of_a_bent_machine_is_twenty_times_better_and_the_gap_is_gone(runs):
    before, after = (replace(stood(bag), beyond=bend).volume() for bag in runs)
    print(f"volume rms, µm: {1e6 * before:.3f}, {1e6 * after:.4f}")
    assert before > 3e-6
    assert before / after > 20.0
    assert verdict(runs[1]) == CONSISTENT
