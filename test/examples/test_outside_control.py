"""A control of another package, as ``docs/compensation.md`` has it: tables are made as for our own.

It writes what the generic one does, under a name of its own. Every command runs in a process of its
own.
"""

import json
import re

import pytest
from other_package import ROOT, install, stepdiag

RUN = ROOT / "docs" / "examples" / "small_run.mcap"
PAGE = (ROOT / "docs" / "compensation.md").read_text(encoding="utf-8")
NAME, TITLE = "workbench", "error map for the workbench"
(MODULE,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
GROUP, KEY, VALUE = re.search(r'entry-points."(\S+)"]\n(\w+) = "(\S+)"', PAGE).groups()


def _install(folder, module):
    points = {GROUP: {KEY: VALUE}}
    install(folder, "workbench-control", {"workbench_control": module}, points)
    return folder


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return _install(tmp_path_factory.mktemp("site"), MODULE)


def test_tables_are_made_for_it(site, tmp_path):
    command = ("compensate", RUN, "--for", NAME, "--despite-verdict", "--pictures", "none")
    folder = tmp_path / "tables"
    done = stepdiag(*command, "--json", "--output", folder, site=site)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert (document["control"], document["title"]) == (NAME, TITLE)
    assert document["changes"]
    assert (folder / "volumetric_map.json").is_file()
    without = stepdiag(*command, "--output", tmp_path / "none")
    assert without.returncode != 0
    assert NAME in without.stderr and "generic" in without.stderr
    assert not (tmp_path / "none").exists()


def test_the_report_shows_it(site, tmp_path):
    done = stepdiag("report", RUN, "--html", "--control", NAME, "--output", tmp_path, site=site)
    assert done.returncode == 0, done.stderr
    assert TITLE in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("command", ["compensate", "report"])
def test_help_names_it(site, command):
    for where in (site, None):
        text = stepdiag(command, "--help", site=where).stdout
        assert "generic" in text
        assert (NAME in text) is (where is site)


@pytest.mark.parametrize(
    "module",
    [
        "import a_module_that_is_not_there\n",
        "CONTROL = 'no control'\n",
        MODULE.replace(f'name = "{NAME}"', 'name = "siemens"'),
        MODULE.replace(f'name = "{NAME}"', 'name = "../up"'),
    ],
    ids=["absent", "of another kind", "taken", "no name"],
)
def test_a_package_that_is_broken_is_named(module, tmp_path):
    site = tmp_path / "site"
    site.mkdir()
    _install(site, module)
    making = ("compensate", RUN, "--for", "generic", "--output", tmp_path / "none")
    for command in (making, ("compensate", "--help")):
        done = stepdiag(*command, site=site)
        assert done.returncode == 1
        assert "workbench-control" in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "none").exists()
