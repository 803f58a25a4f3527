"""A method of another package, as ``docs/methods.md`` has it: installed, it is there like our own.

Module and ``pyproject.toml`` are taken from that page. Every command runs in a process of its own.
"""

import json
import re
from dataclasses import replace

import jsonschema_rs
import pytest
from other_package import ROOT, install, python, stepdiag

from stepdiag_ros.evaluation.report import Report
from stepdiag_ros.metrology.solvers import methods, solvers
from stepdiag_ros.metrology.solvers.catalogue import own_methods
from stepdiag_ros.metrology.solvers.result import VolumetricErrors

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

PAGE = (ROOT / "docs" / "methods.md").read_text(encoding="utf-8")
RUN = ROOT / "docs" / "examples" / "small_run.mcap"
NAME, TITLE = "forward_passes", "Forward passes"
DIFFERENT = 1e-8
"""m: far above rounding."""


def _block(language):
    (text,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    return text


def _install(folder, module):
    described = tomllib.loads(_block("toml"))["project"]
    install(folder, described["name"], {NAME: module}, described["entry-points"])
    return folder


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return _install(tmp_path_factory.mktemp("site"), _block("python"))


@pytest.fixture(scope="module")
def solved(site, tmp_path_factory):
    """Solve with the package installed; return the document and the folder."""
    folder = tmp_path_factory.mktemp("solved")
    asked = ("solve", RUN, "--json", "--details", "--pictures", "svg", "--output", folder)
    done = stepdiag(*asked, site=site)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), folder


def _compensate(of, folder, *more, site=None):
    done = stepdiag(
        *("compensate", of, "--for", "generic", "--despite-verdict", "--pictures", "none"),
        *("--json", "--output", folder, *more),
        site=site,
    )
    if done.returncode:
        return done
    return json.loads(done.stdout)


def test_its_result_stands_beside_the_others(solved):
    document, folder = solved
    curves = {name: one["curves"] for name, one in document["methods"].items()}
    assert {NAME, "conventional", "least_squares"} <= curves.keys()
    pairs = zip(curves[NAME]["E_XX"], curves["least_squares"]["E_XX"], strict=True)
    assert max(abs(one - other) for one, other in pairs) > DIFFERENT
    assert TITLE in (folder / "report.txt").read_text(encoding="utf-8")
    assert TITLE in (folder / "error_curves_by_method.svg").read_text(encoding="utf-8")


def test_the_schema_knows_it_while_it_is_installed(site, solved):
    document, _ = solved
    for where, fits in ((site, True), (None, False)):
        schema = json.loads(stepdiag("schema", "result", site=where).stdout)
        assert jsonschema_rs.Draft202012Validator(schema).is_valid(document) is fits
    lacking = json.loads(json.dumps(document))
    del lacking["methods"][NAME]["curves"]["E_XX"]
    schema = json.loads(stepdiag("schema", "result", site=site).stdout)
    assert not jsonschema_rs.Draft202012Validator(schema).is_valid(lacking)


def test_the_report_to_hand_over_has_it(site, tmp_path):
    done = stepdiag("report", RUN, "--html", "--output", tmp_path, site=site)
    assert done.returncode == 0, done.stderr
    assert TITLE in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_help_and_parameters_name_it(site):
    for command, named in (("solve", True), ("budget", False)):
        for where in (site, None):
            text = stepdiag(command, "--help", site=where).stdout
            assert "least_squares" in text
            assert (NAME in text) is (named and where is site)
    parameters = stepdiag("parameters", "--markdown", site=site)
    assert NAME in parameters.stdout, parameters.stderr


def test_nobody_relies_on_it_unasked(site, solved, tmp_path):
    for asked, used in (("", "least_squares"), (NAME, NAME)):
        more = ("--method", asked) if asked else ()
        made = _compensate(RUN, tmp_path / f"tables_{asked}", *more, site=site)
        assert made["origin"]["method"] == used
    document, _ = solved
    alone = tmp_path / "results.json"
    alone.write_text(json.dumps({**document, "methods": {NAME: document["methods"][NAME]}}))
    refused = _compensate(alone, tmp_path / "none", site=site)
    assert refused.returncode == 1
    assert NAME in refused.stderr and len(refused.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "none").exists()
    named = _compensate(alone, tmp_path / "named", "--method", NAME, site=site)
    assert named["origin"]["method"] == NAME


@pytest.mark.parametrize(
    "module",
    [
        "import a_module_that_is_not_there\n",
        "METHOD = 'no method'\n",
        _block("python").replace('name="forward_passes"', 'name="soons"'),
        _block("python").replace('name="forward_passes"', 'name="forward passes"'),
        _block("python").replace('title="Forward passes"', 'title=""'),
    ],
    ids=["absent", "of another kind", "taken", "no name", "untitled"],
)
def test_a_package_that_is_broken_is_named_in_one_sentence(module, tmp_path):
    site = tmp_path / "site"
    site.mkdir()
    _install(site, module)
    for command in (("solve", RUN, "--output", tmp_path / "none"), ("solve", "--help")):
        done = stepdiag(*command, site=site)
        assert done.returncode == 1
        assert "forward-passes" in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "none").exists()


def test_the_example_is_clean(tmp_path):
    source = tmp_path / f"{NAME}.py"
    source.write_text(_block("python"))
    for check in (("ruff", "check"), ("ruff", "format", "--check")):
        done = python("-m", *check, "--config", ROOT / "pyproject.toml", source)
        assert done.returncode == 0, done.stdout


def _result(method):
    return VolumetricErrors(((), (), ()), {}, method, {}, (), 0, float("nan"), 0)


def test_a_result_is_preferred_by_its_methods_reliance_and_by_nothing_else(monkeypatch):
    every = [*solvers(), "of_a_package_that_is_gone"]
    assert Report(tuple(map(_result, every))).preferred().method == "least_squares"
    assert Report(tuple(map(_result, reversed(every)))).preferred().method == "least_squares"
    assert Report((_result("of_a_package_that_is_gone"),)).preferred() is None
    assert Report(()).preferred() is None
    monkeypatch.setitem(methods(), "soons", replace(methods()["soons"], reliance=99))
    assert Report(tuple(map(_result, every))).preferred().method == "soons"


def test_what_is_preferred_is_shown_last():
    every = [*reversed([*solvers()]), "of_a_package_that_is_gone"]
    report = Report(tuple(map(_result, every)))
    shown = [one.method for one in report.ordered_results()]
    assert sorted(shown) == sorted(every)
    assert shown[-1] == report.preferred().method


def test_our_own_are_told_apart_and_documented():
    for attribute in ("name", "title", "order", "reliance"):
        assert len({getattr(one, attribute) for one in own_methods()}) == len(own_methods())
    rows = [
        f"| `{one.name}` | {one.title} | {one.needs} | {one.source} | `"
        for one in own_methods()
        if one.solve is not None
    ]
    assert len(rows) > 5
    written = [line for line in PAGE.splitlines() if line.startswith(tuple(rows))]
    assert [row in line for row, line in zip(rows, written, strict=True)] == [True] * len(rows)
