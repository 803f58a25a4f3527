"""The page on planning shows a cell in which a plan over the whole travel of a machine is run."""

import re
from pathlib import Path

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
