"""The rules of the house that a machine can check."""

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LONGEST_FUNCTION = 60
"""Lines, without its docstring."""
LOOKED_AT = {
    "commands.compensate_nc._add_options",
    "commands.import_table._add_options",
    "commands.tracker.run_plan",
    "compensation.nc_reading._step",
    "devices.cnc.opcua_settings.from_mapping",
    "embedded.modules.rclpy.action.server.__init__",
    "metrology.discrepancy.baseline.fit_baseline",
    "metrology.standards.diagonal_squareness.from_body",
    "metrology.tracker.adjustment._adjust",
    "metrology.tracker.curves.error_curves",
    "metrology.tracker.evaluation.runs_of_line",
    "metrology.tracker.location.locate",
    "metrology.tracker.multilateration.multilaterate",
    "metrology.uncertainty.jcgm101.monte_carlo",
    "metrology.uncertainty.length_sources.air_sources",
    "report.pages.tracker._parts_of",
}
"""Functions that are longer, and are still to be split or are one list of options or keys."""


@pytest.mark.parametrize(
    "check", [("ruff", "check"), ("ruff", "format", "--check"), ("mypy",)], ids=" ".join
)
def test_the_code_is_linted_formatted_and_typed(check):
    where = [] if check == ("mypy",) else ["."]
    done = subprocess.run(
        [sys.executable, "-m", *check, *where], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


@cache
def tree_of(path):
    return ast.parse(path.read_text())


def long_functions(package=ROOT / "stepdiag_ros"):
    """Return functions whose code is longer than a screen, docstrings aside: name → lines."""
    found = {}
    for path in package.rglob("*.py"):
        module = ".".join(path.relative_to(package).with_suffix("").parts)
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                said = ast.get_docstring(node, clean=False) or ""
                lines = node.end_lineno - node.lineno + 1 - len(said.splitlines())
                if lines > LONGEST_FUNCTION:
                    found[f"{module}.{node.name}"] = lines
    return found


def too_long(found, looked_at):
    """Return what is wrong: functions to be split, and names in the list that can go."""
    limit = f"at most {LONGEST_FUNCTION} without its docstring: split it"
    wrong = [
        f"{name} has {lines} lines; {limit}"
        for name, lines in found.items()
        if name not in looked_at
    ]
    return wrong + [
        f"{name} is short enough or gone: remove it from LOOKED_AT" for name in looked_at - {*found}
    ]


def test_functions_fit_a_screen():
    """A longer one is looked at: it is split, or stands in the list because it is one list."""
    wrong = too_long(long_functions(), LOOKED_AT)
    assert not wrong, "\n".join(wrong)


def test_a_long_function_is_named_with_its_lines(tmp_path):
    body = "    pass\n" * LONGEST_FUNCTION
    (tmp_path / "short.py").write_text(
        f'def fits():\n    """Say.\n\n    More.\n    """\n{body[9:]}'
    )
    (tmp_path / "mistake.py").write_text(f"def long_one():\n{body}")
    found = long_functions(tmp_path)
    assert found == {"mistake.long_one": LONGEST_FUNCTION + 1}
    (wrong,) = too_long(found, set())
    assert "mistake.long_one" in wrong and str(LONGEST_FUNCTION + 1) in wrong
    (wrong,) = too_long(found, {*found, "gone.one"})
    assert "gone.one" in wrong


def test_every_node_is_started_the_same_three_ways():
    from stepdiag_ros.commands.node import NODES
    from stepdiag_ros.processes.cell import simulated_cell

    built = (ROOT / "CMakeLists.txt").read_text()
    simulated = simulated_cell("quick", "demo", "demo", Path(), 1.0, 0.0, 1)
    launched = {process.name for process in simulated} | {
        "scene",
        "by_hand",
        "monitor",
        "foxglove_server",
        "archive",
    }
    for name in NODES:
        module = ROOT / "stepdiag_ros" / "nodes" / f"{name}.py"
        assert module.read_text().startswith("#!/usr/bin/env python3\n"), name
        assert name in built.split("foreach(node ", 1)[1].split(")", 1)[0].split(), name
        assert name in launched, name


def test_nodes_that_solve_nothing_start_without_the_solvers():
    names = ("clock", "recorder", "assembler", "bridge", "interferometer", "sequencer", "weather")
    code = "import sys, importlib, stepdiag_ros.nodes\n"
    code += f"for name in {names}: importlib.import_module(f'stepdiag_ros.nodes.{{name}}')\n"
    code += "print(sorted({'scipy', 'stepdiag_ros.metrology.solvers'} & sys.modules.keys()))"
    told = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert told.stdout.strip() == "[]"


def test_results_are_had_without_any_client():
    """Neither rclpy nor what stands in for it is made importable by who only evaluates."""
    probe = (
        "import importlib.util, sys\n"
        "import stepdiag_ros.notebook, stepdiag_ros.plots, stepdiag_ros.report.publish\n"
        "print('stepdiag_ros.client' in sys.modules, 'stepdiag_ros.embedded.finder' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", probe], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.split() == ["False", "False"], done.stderr


def test_devices_and_metrology_know_no_ros():
    for folder in ("metrology", "devices"):
        for path in (ROOT / "stepdiag_ros" / folder).rglob("*.py"):
            text = path.read_text()
            assert "rclpy" not in text and "stepdiag_ros.nodes" not in text, path


FLOORS = (
    "metrology",
    "text",
    "resources",
    "topics",
    "parameters",
    "configuration",
    "devices",
    "run",
    "planning",
    "schemas",
    "embedded",
    "client",
    "messages",
    "bags",
    "compensation",
    "evaluation",
    "archive",
    "selftest",
    "notebook",
    "words",
    "plots",
    "report.documents",
    "report.tables",
    "report",
    "report.pages",
    "report.certificate",
    "viewers",
    "nodes",
    "processes",
    "commands",
    "cli",
)
"""Packages and files of the root; each may import those before it, and nothing behind it."""


def floor_of(module):
    """Return how high a module is, by the longest name in ``FLOORS`` that it begins with."""
    found = [name for name in FLOORS if module == name or module.startswith(f"{name}.")]
    assert found, f"{module} is on no floor: give it one in FLOORS"
    return FLOORS.index(max(found, key=len))


def imported(path):
    """Yield what a file imports of this package, as names below it, from its syntax tree."""
    for node in ast.walk(tree_of(path)):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:
            package, _, below = name.partition(".")
            if package == "stepdiag_ros" and below not in ("", "__version__"):
                yield below


def test_the_table_of_folders_is_in_the_order_of_imports():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    table = text.split("| folder | contents |", 1)[1].split("\n\n", 1)[0]
    rows = [row.split("|")[1] for row in table.splitlines() if row.startswith("| ")]
    listed = [name for row in rows for name in re.findall("`(.+?)`", row)]
    package = ROOT / "stepdiag_ros"
    assert listed == [floor for floor in FLOORS if (package / floor).is_dir()]


def test_imports_point_inwards():
    """Nothing imports upwards, so that there is no circle between packages either."""
    package = ROOT / "stepdiag_ros"
    wrong = []
    for path in package.rglob("*.py"):
        module = ".".join(path.relative_to(package).with_suffix("").parts)
        module = module.removesuffix("__init__").rstrip(".")
        if not module or module.startswith("embedded.modules"):
            continue
        for below in imported(path):
            if floor_of(below) > floor_of(module):
                wrong.append(f"{module} imports {below}")
    assert wrong == []


def test_tables_are_laid_out_for_a_terminal_in_one_place():
    """What makes a table knows neither terminal nor page: rich is for those that draw."""
    package = ROOT / "stepdiag_ros"
    drawing = set()
    for path in package.rglob("*.py"):
        for node in ast.walk(tree_of(path)):
            names = [alias.name for alias in getattr(node, "names", ()) if hasattr(alias, "name")]
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            if any(name.split(".")[0] == "rich" for name in names):
                drawing.add(".".join(path.relative_to(package).with_suffix("").parts))
    progress_bars = "commands.output"
    assert {name for name in drawing if not name.startswith("viewers.terminal.")} == {
        "text.console",
        progress_bars,
    }
