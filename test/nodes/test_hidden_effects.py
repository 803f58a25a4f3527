"""Effects in the simulated cell on the node graph: they are in the readings, not in the bag."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.configuration import find, load_cell
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.simulation import read_again
from stepdiag_ros.run.sequence import State
from stepdiag_ros.text.intake import parse_yaml

PLAN = """
name: small, both ways
step_m: [0.02, 0.015, 0.01]
blocks: 2
directions: [forward, backward]
feed_m_per_s: 0.1
pause_for_setup: false
lines:
  - {kind: linear, names: [x]}
  - {kind: step_diagonal, names: [ppp], orders: [XYZ]}
sampling: {dwell_s: 0.2, settle_s: 0.15, window_s: 0.1}
"""
EFFECTS = """
- {effect: backlash, setting: {axis: X}, sizes: {lost_motion: 2.0e-6}}
- {effect: settling, setting: {axis: Y}, sizes: {short_by: 1.0e-6}}
- effect: fringe slip
  setting: {line: ppp, order: XYZ, repeat: 0, direction: backward, from_stop: 3}
  sizes: {size: 0.7e-6}
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hidden")
    (folder / "plan.yaml").write_text(PLAN)
    cell = parse_yaml(find("demo", "cells").read_text(), "demo")
    cell["reading_noise_m"] = 1e-9
    cell["effects"] = parse_yaml(EFFECTS, "effects")
    (folder / "cell.yaml").write_text(yaml.safe_dump(cell))
    return folder / "plan.yaml", folder / "cell.yaml"


def test_effects_are_in_the_readings_and_not_in_the_bag(make_cell, files):
    plan, cell = files
    with make_cell(plan=str(plan), factor=20.0, cell=str(cell)) as nodes:
        nodes.start()
        nodes.wait_for_state(State.FINISHED)
        nodes.wait(nodes.bag_is_closed, "the bag is closed")
        (bag,) = nodes.folder.glob("*.mcap")

    run = load_run(bag)
    truth, _ = load_cell(str(cell))
    measured = Measurement(run.plan.volume, run.lines, truth.chain)
    found = stops_of(measured).displacement
    with_them = stops_of(read_again(measured, truth)).displacement
    without = stops_of(read_again(measured, replace(truth, effects=()))).displacement
    assert np.ptp(with_them - without) > 2e-6
    assert found == pytest.approx(with_them, abs=10e-9)

    with BagReader(bag) as reader:
        told = reader.header.simulated_cell
    for text in (told, run.cell_text, bag.read_bytes().decode("latin-1")):
        assert "from_stop: 3" not in text and "effect: backlash" not in text
    assert "SHA-256" in told and told == run.cell_text
    assert parse_yaml(run.cell_text, "bag")["seed"] == truth.seed
