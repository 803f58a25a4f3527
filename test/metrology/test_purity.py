"""Physics and estimation know numpy, scipy and the standard library, and nothing else."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import stepdiag_ros.metrology

FOLDER = Path(stepdiag_ros.metrology.__file__).parent
MODULES = sorted(FOLDER.rglob("*.py"))

PROBE = """
import importlib, sys
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec

class Refusal(Loader):
    def create_module(self, spec):
        raise ImportError(f"metrology imports {spec.name}")

    def exec_module(self, module):
        pass

class Wall(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if name in ("stepdiag_ros", "stepdiag_ros.metrology"):
            return None
        if name.startswith("stepdiag_ros.metrology."):
            return None
        if top in sys.stdlib_module_names or top in ("numpy", "scipy"):
            return None
        if top.startswith("_sysconfigdata"):  # of the standard library, named after the platform
            return None
        return ModuleSpec(name, Refusal())

sys.meta_path.insert(0, Wall())
for name in sys.argv[1:]:
    importlib.import_module(name)
print("scipy" in sys.modules)
"""


def name_of(path):
    parts = ("stepdiag_ros", "metrology", *path.relative_to(FOLDER).with_suffix("").parts)
    return ".".join(parts).removesuffix(".__init__")


def test_metrology_imports_with_everything_else_blocked():
    run = subprocess.run(
        [sys.executable, "-c", PROBE, *map(name_of, MODULES)],
        capture_output=True,
        text=True,
        cwd=FOLDER.parent.parent,
    )
    assert run.returncode == 0, run.stderr


def test_all_but_the_solvers_start_without_scipy():
    run = subprocess.run(
        [
            sys.executable,
            "-c",
            PROBE,
            "stepdiag_ros.metrology.assembly",
            "stepdiag_ros.metrology.cell",
        ],
        capture_output=True,
        text=True,
        cwd=FOLDER.parent.parent,
    )
    assert run.stdout.strip() == "False", run.stderr


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_no_module_names_anything_else_even_inside_a_function(path):
    for node in ast.walk(ast.parse(path.read_text())):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: relative import"
            names = [node.module]
        for name in names:
            top = name.partition(".")[0]
            known = top in sys.stdlib_module_names or top in ("numpy", "scipy")
            assert known or name.startswith("stepdiag_ros.metrology"), f"{path.name}: {name}"
