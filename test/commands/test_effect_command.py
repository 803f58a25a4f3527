"""``stepdiag effect new``: the package of an effect, whose test passes and fails by its formula."""

import ast
import re
import shlex
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
import yaml
from refused import refused

from stepdiag_ros import cli
from stepdiag_ros.metrology import registry
from stepdiag_ros.metrology.effects import ENTRY_POINTS, catalogue
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.report.effect_package import checked_name, package_of

ROOT = Path(__file__).parents[2]
BOX = {"X_m": [0.01, 0.13], "Y_m": [0.0, 0.2], "Z_m": [-0.02, 0.14]}
TURNED = {"sense_X": [-1.0, 1.0], "since_reversal_X_s": [0.0, 50.0]}
EVERY = (
    ("Y", "x>0.3 * z<0.7", {one: BOX[one] for one in ("X_m", "Z_m")}),
    ("X", "y^3 * sense z", {"Y_m": BOX["Y_m"], "sense_Z": [-1.0, 1.0]}),
    ("Z", "z~0.4", {"Z_m": BOX["Z_m"]}),
    ("X", "creep x 40s", TURNED),
    ("Y", "t^2 * start 600s", {"time_s": [0.0, 900.0]}),
    ("Y", "from 20s to 60s * x^1", {"time_s": [0.0, 900.0], "X_m": BOX["X_m"]}),
    ("Z", "sin t/300s * cos t/200s", {"time_s": [0.0, 900.0]}),
    (
        "reading",
        "material^1 * air^2",
        {"material_temperature_degC": [19.0, 21.0], "air_temperature_degC": [19.0, 22.0]},
    ),
)
"""Every kind of factor: what it acts on, shape, domain."""


def model_of(folder, shapes, sizes=None):
    sizes = sizes or [1e-6 * (-1) ** count * (count + 1) for count in range(len(shapes))]
    path = folder / "model.yaml"
    entries = [
        {
            "effect": "learned shape",
            "setting": {"acts_on": acts_on, "shape": shape},
            **({"domain": domain} if domain else {}),
            "sizes": {"amplitude": size},
            "provenance": {"bag": "run.mcap"},
        }
        for (acts_on, shape, domain), size in zip(shapes, sizes, strict=True)
    ]
    path.write_text(yaml.safe_dump({"effects": entries}))
    return path


def new(*arguments):
    return cli.main(["effect", "new", *map(str, arguments)])


HIDDEN = "test_it_is_named_where_it_is_hidden"


def failing(folder, module, without=()):
    """Run the tests of a package in this process; return names of those that fail."""
    failed = []
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        # The turned module is as old and as long as the one before it.
        patch.setattr(sys, "dont_write_bytecode", True)
        held: dict = {}
        exec(compile((folder / f"test_{module}.py").read_text(), module, "exec"), held)
        for name, test in held.items():
            if name.startswith("test_") and name not in without:
                try:
                    test()
                except AssertionError:
                    failed.append(name)
    sys.modules.pop(module)
    return failed


@pytest.mark.parametrize(
    "shapes",
    [EVERY, *((one,) for one in EVERY), (("Y", "x^1 * z^1", None),)],
    ids=["all", *(one[1] for one in EVERY), "no domain"],
)
def test_the_generated_test_passes_and_fails_if_the_sign_is_turned(tmp_path, shapes):
    folder = tmp_path / "package"
    assert new("quadrant bend", "--model", model_of(tmp_path, shapes), "--output", folder) == 0
    assert sorted(path.name for path in folder.iterdir()) == [
        *("pyproject.toml", "quadrant_bend.py", "test_quadrant_bend.py")
    ]
    # What one formula alone is hidden and named for, is tested below; it takes seconds.
    assert failing(folder, "quadrant_bend", [HIDDEN]) == []
    module = folder / "quadrant_bend.py"
    text = module.read_text()
    module.write_text(text.replace("] += ", "] -= ").replace("reading += ", "reading -= "))
    assert module.read_text() != text
    assert failing(folder, "quadrant_bend", [HIDDEN]) == ["test_the_change_is_the_formula"]


def test_a_learned_formula_is_hidden_and_named_in_its_test(tmp_path):
    folder = tmp_path / "package"
    model = model_of(tmp_path, EVERY[:1], [5e-6])
    assert new("quadrant bend", "--model", model, "--output", folder) == 0
    assert HIDDEN in (folder / "test_quadrant_bend.py").read_text()
    assert failing(folder, "quadrant_bend") == []
    # Where the readings do not show the size, its test fails.
    test = folder / "test_quadrant_bend.py"
    test.write_text(test.read_text().replace("SIZE = 5e-06", "SIZE = 5e-09"))
    assert failing(folder, "quadrant_bend") == [HIDDEN]


@pytest.mark.parametrize("learned", [False, True])
def test_the_generated_folder_is_clean(tmp_path, learned):
    model = ("--model", model_of(tmp_path, EVERY)) if learned else ()
    assert new("bend of mine", *model, "--output", tmp_path / "bend_of_mine") == 0
    for place in (tmp_path, ROOT):
        # Imports are sorted by what lies beside them: also those of a package in this repository.
        settings = ["--config", str(ROOT / "pyproject.toml"), "--no-cache"]
        done = subprocess.run(
            [sys.executable, "-m", "ruff", "check", *settings, str(tmp_path / "bend_of_mine")],
            cwd=place,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0 or place == tmp_path, done.stdout
        assert "D103" not in done.stdout, done.stdout


def bare(text):
    """Return the code of a module without docstrings, comments, and what its author states."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        node.body = [
            one
            for one in body
            if not (isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant))
            and not (
                isinstance(one, ast.Assign)
                and getattr(one.targets[0], "id", "") in ("sentence", "source")
            )
        ]
    return ast.unparse(tree)


def test_the_example_is_that_of_the_page_on_effects():
    page = (ROOT / "docs" / "effects.md").read_text()
    made = package_of("cooler cycle", set())
    for name in ("cooler_cycle.py", "test_cooler_cycle.py"):
        (shown,) = re.findall(rf"`{name}`:\n\n```python\n(.*?)```", page, re.DOTALL)
        assert bare(made[name]) == bare(shown)


def test_without_a_model_there_is_an_example_to_be_edited(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert new("plain-thing") == 0
    # pip takes a name without a slash as that of a package in its index.
    (installed,) = re.findall("'pip install (.*?)'", capsys.readouterr().err)
    assert installed == "./plain_thing"
    assert failing(tmp_path / "plain_thing", "plain_thing") == []
    record = (tmp_path / "plain_thing" / "pyproject.toml").read_text()
    assert 'plain_thing = "plain_thing:EFFECT"' in record and 'name = "plain-thing"' in record


def test_a_folder_that_is_given_is_installed_as_a_path(tmp_path, capsys):
    folder = tmp_path / "of mine"
    assert new("plain-thing", "--output", folder) == 0
    (installed,) = re.findall("'pip install ('.*?')'", capsys.readouterr().err)
    assert shlex.split(installed) == [str(folder)]


@pytest.mark.parametrize("learned", [False, True])
def test_the_catalogue_refuses_it_until_its_author_states_what_happens(
    tmp_path, monkeypatch, learned
):
    model = ("--model", model_of(tmp_path, EVERY[:1])) if learned else ()
    assert new("bend-to-state", *model, "--output", tmp_path / "package") == 0
    module = tmp_path / "package" / "bend_to_state.py"
    point = EntryPoint("bend_to_state", "bend_to_state:EFFECT", ENTRY_POINTS)
    monkeypatch.setattr(registry, "installed_points", lambda _: [point])
    monkeypatch.syspath_prepend(str(module.parent))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    for empty, stated in (
        ("sentence", "The column bends."),
        *(() if learned else (("source", "Manual of the machine."),)),
    ):
        with refused(Refusal, "wrong_kind", f"'{empty}'"):
            catalogue()
        text = module.read_text()
        assert text.count(f'    {empty} = ""') == 1
        module.write_text(text.replace(f'    {empty} = ""', f'    {empty} = "{stated}"'))
        sys.modules.pop("bend_to_state")
    assert catalogue()["bend to state"].sentence == "The column bends."
    sys.modules.pop("bend_to_state")


@pytest.mark.parametrize("there", ["quadrant_bend.py", "test_quadrant_bend.py", "pyproject.toml"])
def test_no_file_is_overwritten(tmp_path, there, capsys):
    (tmp_path / there).write_text("mine")
    assert new("quadrant-bend", "--output", tmp_path) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == [there]
    assert (tmp_path / there).read_text() == "mine"


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        *((one, "malformed") for one in ("", "Bend", "3d", "a  b", "../x", "a/b", "x\n", "ä")),
        *((one, "twice") for one in ("backlash", "thermal-growth", "json", "class", "numpy")),
    ],
)
def test_a_name_that_cannot_be_one_is_refused(tmp_path, name, fault):
    with refused(Refusal, fault, "name"):
        checked_name(name, catalogue())
    assert new(name, "--output", tmp_path / "none") == 1
    assert not (tmp_path / "none").exists()


def test_a_model_that_has_learned_nothing_is_refused(tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text("curves: free\n")
    assert new("bend", "--model", path, "--output", tmp_path / "none") == 1
    assert not (tmp_path / "none").exists()


def test_a_model_that_is_not_there_says_after_which_verdicts_one_is_written(tmp_path, capsys):
    name = str(tmp_path / "none.yaml")
    assert new("bend", "--model", name, "--output", tmp_path / "none") == 1
    told = capsys.readouterr().err
    assert name in told and "NAMED" in told and "DESCRIBED" in told
    assert not (tmp_path / "none").exists()


def test_a_rotation_is_left_to_be_written_by_hand(tmp_path):
    path = model_of(tmp_path, (("E_AX", "x^1 * t^1", None),))
    path.write_text(path.read_text().replace("learned shape", "learned rotation"))
    assert new("bend", "--model", path, "--output", tmp_path / "none") == 1
    assert not (tmp_path / "none").exists()


def test_shapes_over_different_boxes_are_not_one_effect(tmp_path):
    shapes = (("Y", "x^1 * z^1", {"X_m": [0, 0.1], "Z_m": [0, 0.1]}), ("Y", "x^2", {"X_m": [0, 1]}))
    assert new("bend", "--model", model_of(tmp_path, shapes), "--output", tmp_path / "none") == 1


def test_the_record_is_laid_out_as_the_page_on_effects_has_it():
    page = (ROOT / "docs" / "effects.md").read_text()
    (shown,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    made = package_of("cooler cycle", set())["pyproject.toml"]
    assert made == shown.replace('version = "1.0"', 'version = "0.1"')


def test_what_a_model_says_of_its_bag_stays_a_text(tmp_path):
    path = model_of(tmp_path, EVERY[:1])
    path.write_text(path.read_text().replace("run.mcap", """'a"\\n; import os #'"""))
    assert new("bend of mine", "--model", path, "--output", tmp_path / "package") == 0
    (line,) = [
        one
        for one in (tmp_path / "package" / "bend_of_mine.py").read_text().splitlines()
        if one.startswith("    source = ")
    ]
    assert line.count('"') == 2 and "\\" not in line


def test_the_list_names_every_effect_once_with_its_keys(capsys):
    assert cli.main(["effect", "list"]) == 0
    shown = capsys.readouterr().out
    for name, effect in catalogue().items():
        (line,) = (one for one in shown.splitlines() if one.startswith(f" {name}  "))
        assert all(key.name in line for key in effect.keys)
