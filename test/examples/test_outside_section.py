"""A section of another package, as ``docs/report.md`` has it: the report shows it like our own."""

import json
import re

import pytest
from other_package import ROOT, install, stepdiag
from report.pages.page_reading import sections_without_archive

from stepdiag_ros.report.pages.sections import sections

PAGE = (ROOT / "docs" / "report.md").read_text(encoding="utf-8")
RUN = ROOT / "docs" / "examples" / "small_run.mcap"
NAME, TITLE = "line_count", "Number of lines"
(MODULE,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
GROUP, KEY, VALUE = re.search(r'entry-points."(\S+)"]\n(\w+) = "(\S+)"', PAGE).groups()


def _report(folder, module):
    site = folder / "site"
    site.mkdir()
    install(site, "line-count", {NAME: module}, {GROUP: {KEY: VALUE}})
    return stepdiag("report", RUN, "--html", "--json", "--output", folder / "out", site=site)


def test_it_stands_in_its_place_on_the_page_and_in_the_document(tmp_path):
    done = _report(tmp_path, MODULE)
    assert done.returncode == 0, done.stderr
    html = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    document = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    own = [one.name for one in sections_without_archive()]
    expected = [own[0], NAME, *own[1:]]
    assert re.findall(r'<section id="(\w+)">', html) == expected
    assert re.findall(r'<li><a href="#(\w+)">', html) == expected
    assert f"<h2>2 {TITLE}</h2>" in html
    count = document["sections"][NAME]["lines"]
    lines = document["sections"]["readings"]["lines"]
    assert count == sum(one["passes_measured"] for one in lines) > 0
    assert f"<p>{count} lines were measured.</p>" in html


@pytest.mark.parametrize(
    "module",
    [
        "import a_module_that_is_not_there\n",
        "SECTION = 'no section'\n",
        MODULE.replace(f'"{NAME}"', '"curves"'),
        MODULE.replace(f'"{NAME}"', '"line count"'),
        MODULE.replace(f'"{TITLE}"', '""'),
    ],
    ids=["absent", "of another kind", "taken", "no name", "untitled"],
)
def test_a_package_that_is_broken_is_named_in_one_sentence(module, tmp_path):
    done = _report(tmp_path, module)
    assert done.returncode == 1
    assert "line-count" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_our_own_are_told_apart():
    for attribute in ("name", "title", "order"):
        assert len({getattr(one, attribute) for one in sections()}) == len(sections())
