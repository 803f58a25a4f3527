"""What has no name, in a whole cell: described while it is measured, learned, and gone.

Three kinds are hidden in the simulated cell. The bend is also compensated and measured again.
"""

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest
import yaml
from closed_loop import BLOCKS, ORIGIN, PLAN, STEP, compensate, stood, twin
from domains import room_for_a_cell

from stepdiag_ros.bags.run import load_run
from stepdiag_ros.cli import main
from stepdiag_ros.metrology.discrepancy import CONSISTENT, DESCRIBED
from stepdiag_ros.processes.cell import simulated_cell
from stepdiag_ros.processes.measure import MeasuringSession

FACTOR = 8.0
DIAGONALS = """\
  - kind: step_diagonal
    names: [ppp, npp, pnp, ppn]
    orders: [XYZ, YZX]
"""


@dataclass(frozen=True)
class Hidden:
    """What acts along an axis, m at the most."""

    acts_on: str
    shape: str
    size: float

    def as_mapping(self):
        setting = {"acts_on": self.acts_on, "shape": self.shape}
        sizes = {"amplitude": self.size}
        return {"effect": "learned shape", "setting": setting, "sizes": sizes}


BEND = Hidden("Y", "x>0.5 * z>0.5", 4e-6)
OTHERS = {
    "load": Hidden("X", "y^1 * sense x", 0.8e-6),
    "spot": Hidden("Z", "x~0.4 * y~0.6", 3e-6),
}


def bend(places):
    """Return how far the tool is displaced along Y where X and Z are beyond the middle, m."""
    beyond = np.maximum(2.0 * (places - ORIGIN) / (STEP * BLOCKS) - 1.0, 0.0)
    moved = np.zeros_like(places)
    moved[:, 1] = BEND.size * beyond[:, 0] * beyond[:, 2]
    return moved


def measured(folder, hidden, model="free", correction=""):
    folder.mkdir()
    plan, cell = folder / "plan.yaml", folder / "cell.yaml"
    text = PLAN.replace("DIAGONALS\n", DIAGONALS).replace("repeats: 1", "repeats: 2")
    # In one direction alone, a change of the reading with the sense of Y would look the same.
    plan.write_text(text.replace("[forward]", "[forward, backward]"))
    cell.write_text(yaml.safe_dump({**json.loads(twin()), "effects": [hidden.as_mapping()]}))
    nodes = simulated_cell(
        *(str(plan), "demo", str(cell), folder, FACTOR, 0.0, 1), str(model), str(correction)
    )
    nodes = [node for node in nodes if node.name != "evaluator"]
    with room_for_a_cell():
        return MeasuringSession(nodes, folder, lambda _: None).measure()


def live_verdict(bag):
    """Return the last verdict that the diagnosis node published, and what it found."""
    last = load_run(bag).diagnoses[-1]
    assert last.run_over
    return last.verdict, [(one.setting["acts_on"], one.setting["shape"]) for one in last.findings]


def extended(bag, model):
    """Learn what a run has shown, with its verdict from the bag."""
    options = ("--pictures", "none", "--output", str(bag.parent / "diagnosis"))
    assert main(["diagnose", str(bag), *options, "--extend", str(model)]) == 0
    return json.loads((bag.parent / "diagnosis" / "diagnosis.json").read_text())["verdict"]


@pytest.mark.parametrize("name", OTHERS)
def test_described_live_and_gone_with_the_model_that_has_learned_it(name, tmp_path):
    hidden, model = OTHERS[name], tmp_path / "learned.yaml"
    first = measured(tmp_path / "first", hidden)
    verdict, found = live_verdict(first)
    assert verdict == DESCRIBED
    assert {acts_on for acts_on, _ in found} == {hidden.acts_on}
    assert extended(first, model) == DESCRIBED
    assert live_verdict(measured(tmp_path / "second", hidden, model)) == (CONSISTENT, [])


@pytest.fixture(scope="module")
def bent_runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bend")
    first, model = measured(folder / "first", BEND), folder / "bent.yaml"
    assert extended(first, model) == DESCRIBED
    error_map = compensate(first, "generic", folder / "map", "--model", str(model))
    correction = error_map / "volumetric_map.json"
    return first, measured(folder / "second", BEND, correction=correction)


def test_the_volume_of_a_bent_machine_is_twenty_times_better_and_the_gap_is_gone(bent_runs):
    before, after = (replace(stood(bag), beyond=bend).volume() for bag in bent_runs)
    print(f"volume rms, µm: {1e6 * before:.3f}, {1e6 * after:.4f}")
    assert before > 3e-6
    assert before / after > 20.0
    assert [live_verdict(bag)[0] for bag in bent_runs] == [DESCRIBED, CONSISTENT]
