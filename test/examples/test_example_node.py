"""The example node of docs/examples beside a replayed run: what it prints are the results."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Timer
from typing import Any

import numpy as np
import pytest
from patience import PATIENCE
from ros_processes import domain, node, ros, spin_until

from stepdiag_ros.bags.run import load_run
from stepdiag_ros.evaluation.solving import solve_reproducibly
from stepdiag_ros.metrology.solvers.result import VolumetricErrors

__all__ = ["domain", "node", "ros"]

ROOT = Path(__file__).parents[2]
CASE = ROOT / "test/data/cases/four_diagonals"
EXAMPLE = ROOT / "docs/examples/watch_results.py"


def stepdiag(*arguments: object) -> None:
    command = [sys.executable, "-m", "stepdiag_ros.cli", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr


@pytest.fixture
def background() -> Iterator[list[subprocess.Popen[str]]]:
    """Return a list of processes that are ended with the test."""
    started: list[subprocess.Popen[str]] = []
    yield started
    for process in started:
        process.terminate()
    for process in started:
        process.communicate(timeout=PATIENCE)


def one_pass(folder: Path) -> Path:
    """Return a table with the first pass of each line of the case alone: soon solved."""
    (folder / "case.yaml").write_text((CASE / "case.yaml").read_text())
    head, *rows = (CASE / "run.csv").read_text().splitlines()
    table = folder / "run.csv"
    table.write_text("\n".join([head, *(row for row in rows if ",0,forward," in row)]) + "\n")
    return table


def worst_in_words(result: VolumetricErrors, kind: str, letters: str, unit: str) -> str:
    """Return what the example must say of the largest error of a kind."""
    curves = {name: curve for name, curve in result.curves.items() if name[2] in letters}
    if not curves:
        return ""
    # The first value is zero by definition, also of a curve of which nothing else is known.
    known = {name: curve for name, curve in curves.items() if np.isfinite(curve[1:]).any()}
    if not known:
        return f"no {kind} is known"
    name = max(known, key=lambda one: np.nanmax(np.abs(known[one])))
    at = int(np.nanargmax(np.abs(known[name])))
    value, u = curves[name][at] * 1e6, result.standard_uncertainty[name][at] * 1e6
    place = result.nodes["XYZ".index(name[3])][at] * 1e3
    sure = f"standard uncertainty {u:.2f} {unit}" if np.isfinite(u) else "u unknown"
    return f"largest {kind} {name} = {value:.2f} {unit} at {name[3]} = {place:.1f} mm ({sure})"


def test_the_example_tells_the_worst_errors(
    tmp_path: Path, node: Any, background: list[subprocess.Popen[str]]
) -> None:
    bag = tmp_path / "run.mcap"
    stepdiag("import", one_pass(tmp_path), bag)
    for command in ([str(EXAMPLE)], ["-m", "stepdiag_ros.nodes.solver"]):
        background.append(
            subprocess.Popen([sys.executable, *command], stdout=subprocess.PIPE, text=True)
        )
    heard = ("/measurement/line", "/result/volumetric_errors")
    assert spin_until(node, lambda: all(node.count_subscribers(name) for name in heard))
    stepdiag("replay", bag, "--rate", "2000")
    solved, _ = solve_reproducibly(load_run(bag).measurement)
    told: dict[str, str] = {}
    example = background[0]
    assert example.stdout is not None
    limit = Timer(60.0, example.kill)
    limit.start()
    for line in example.stdout:
        method, _, text = line.partition(",")
        told[method] = text
        if all(f" {result.lines} lines" in told.get(name, "") for name, result in solved.items()):
            break
    limit.cancel()
    for method, result in solved.items():
        assert worst_in_words(result, "displacement", "XYZ", "µm") in told[method]
        assert worst_in_words(result, "rotation", "ABC", "µrad") in told[method]
    assert "rotation" in told["rigid_body"]
