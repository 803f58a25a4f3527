"""docs/safety.md: every fault has a test that exists, and the figures are those of the code."""

import re
from pathlib import Path

from stepdiag_ros.devices import known_drivers
from stepdiag_ros.metrology.beam import MISALIGNMENT
from stepdiag_ros.metrology.fringe_count import FLOOR, ROUGHNESS
from stepdiag_ros.nodes.sequencer import PERMIT_PERIOD
from stepdiag_ros.parameters.nodes import declared_node
from stepdiag_ros.run.motion_watch import ASTRAY, SETTLE_LIMIT
from stepdiag_ros.run.permission import LONGEST_DEAD_MAN
from stepdiag_ros.run.sequence import ANSWER_LIMIT, BEAM_LIMIT

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
TEXT = " ".join(PAGE.split())


def rows(head, columns):
    table = PAGE.split(head, 1)[1].split("\n\n", 1)[0]
    found = [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]
    assert {len(row) for row in found} == {columns}
    return found


def test_every_fault_has_a_test_that_exists():
    faults = rows("| no. | fault | what is seen |", 5)
    tests = rows("| no. | test |", 2)
    assert len(faults) >= 25
    assert [row[0] for row in faults] == [row[0] for row in tests]
    for number, test in tests:
        found = re.fullmatch(r"\[`(?P<path>\S+)::(?P<test>\w+)`\]\(\.\./(?P<link>\S+)\)", test)
        assert found, f"no test in row {number}"
        assert found["path"] == found["link"]
        text = (ROOT / found["path"]).read_text(encoding="utf-8")
        assert re.search(rf"^def {found['test']}\(", text, re.MULTILINE), test


def test_figures_are_those_of_the_code():
    limit = declared_node("bridge").find("silence_limit").default
    assert f"`silence_limit` ({limit:g} s; a parameter of the bridge)" in TEXT
    assert PERMIT_PERIOD == 0.1 and "ten times a second" in TEXT
    assert f"at most {ANSWER_LIMIT:g} s by the computer's clock" in TEXT
    assert f"still outside the window {SETTLE_LIMIT:g} s later" in TEXT
    assert f"an axis is {ASTRAY * 1e3:g} mm away from the straight path" in TEXT
    assert f"its watchdog takes longer than {LONGEST_DEAD_MAN:g} s" in TEXT
    assert f"hold after {BEAM_LIMIT:g} s" in TEXT
    assert f"While the axes stand, it detects errors above {FLOOR * 1e6:g} µm" in TEXT
    assert f"the limit is {FLOOR * 1e6:g} µm + {MISALIGNMENT * 100:g} % of the travelled" in TEXT
    assert f"it is {2 * FLOOR * 1e6:g} µm + {ROUGHNESS * 100:g} % of the distance" in TEXT


def test_every_driver_says_what_happens_when_the_bridge_is_killed():
    table = PAGE.split("| driver | when the bridge's process is killed", 1)[1].split("\n\n", 1)[0]
    for driver in known_drivers("cnc"):
        assert f"`{driver}`" in table, driver
