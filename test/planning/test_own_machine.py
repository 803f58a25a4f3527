"""The page on planning shows a cell in which a plan over the whole travel of a machine is run."""

import re
from pathlib import Path

import numpy as np
import pytest

from stepdiag_ros.configuration import load_cell, load_machine
from stepdiag_ros.metrology.live_effects import check_measurable
from stepdiag_ros.planning.proposal import propose
from stepdiag_ros.planning.request import Request

PAGE = Path(__file__).parents[2] / "docs" / "planning.md"


def test_the_cell_of_the_page_covers_the_travel_of_its_machine(tmp_path):
    path = tmp_path / "my_cell.yaml"
    (text,) = re.findall(r"```yaml\n(name: my cell\n.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    path.write_text(text)
    machine = load_machine("demo")[0]
    plan = propose(Request("quick", machine)).chosen.plan
    check_measurable(plan, load_cell(path)[0])


def test_the_page_shows_errors_of_ones_own_choice(tmp_path):
    path = tmp_path / "my_cell.yaml"
    (text,) = re.findall(r"```yaml\n(errors:\n  nodes_m.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    path.write_text(f"name: my cell\nchain: YXZ\n{text}")
    errors = load_cell(path)[0].errors
    x_end, y_end = (errors.at(axis, np.array([end]))[0] for axis, end in enumerate((0.9, 0.5)))
    # C0Y turns the curve E_XY: -E_XY grows along Y by the angle.
    assert x_end == pytest.approx([23.75e-6, 0.0, 0.0, 0.0, 0.0, 10e-6])
    assert y_end == pytest.approx([-30e-6 * 0.55, 0.0, 0.0, 0.0, 0.0, 0.0])
