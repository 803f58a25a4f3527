"""The tutorial: its commands run in its order, and what it says is what comes of them.

Where a command of the tutorial measures on nodes (``stepdiag demo`` and ``stepdiag run``), the same
plan is measured here on the same cell by the simulation without nodes, which takes a second in
place of a minute; that these commands measure on nodes is tested in test/nodes. All other commands
run as they stand.
"""

import re
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
import standard_runs
from test_shell_blocks import commands

from stepdiag_ros import configuration
from stepdiag_ros.cli import main, make_parser
from stepdiag_ros.compensation.generic import correction_from_file
from stepdiag_ros.metrology.simulation import planned_run, read_again
from stepdiag_ros.metrology.target_correction import target_for

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial"
MEASURING = ("demo", "run")
NOISE = 0.1e-6 / 30**0.5
"""m: of a stop of the demonstration, the mean of 30 readings."""


def page(name):
    return (TUTORIAL / f"{name}.md").read_text(encoding="utf-8")


def measure(words):
    """Measure as a command would, without nodes, and put the bag where the command does."""
    given = make_parser().parse_args(words)
    plan, text = configuration.load_plan(str(configuration.find(given.plan, "plans")))
    cell, _ = configuration.load_cell(str(configuration.find(given.cell, "cells")))
    asked = planned_run(plan, cell)
    sent = asked
    if given.correction is not None:
        error_map = correction_from_file(given.correction, 1e-3).error_map
        moved = [replace(one, target=target_for(error_map, one.target)) for one in asked.lines]
        sent = replace(asked, lines=tuple(moved))
    read = read_again(sent, cell, NOISE, seed=1)
    lines = [
        replace(one, target=nominal.target)
        for one, nominal in zip(read.lines, asked.lines, strict=True)
    ]
    folder = given.output or Path("stepdiag_results")
    folder.mkdir()
    measurement = replace(read, lines=tuple(lines))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(standard_runs, "RUN_ID", folder.name)
        patch.setattr(standard_runs, "measured", lambda *_: (plan, measurement))
        standard_runs.write_bag(folder / "run.mcap", text, with_tests=False)


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """Run the tutorial; page → what its commands printed, one text a command."""
    folder = tmp_path_factory.mktemp("tutorial")
    printed = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for path in sorted(TUTORIAL.glob("[1-9]_*.md")):
            printed[path.stem] = [ran(words) for words in commands(path.read_text())]
    return printed


def globbed(word):
    return sorted(map(str, Path().glob(word)))


def ran(words):
    words = [
        name for word in words for name in (map(str, Path().glob(word)) if "*" in word else [word])
    ]
    if words[0] in MEASURING:
        measure(words)
        return ""
    with redirect_stdout(StringIO()) as stream:
        assert main(words) == 0, words
    return stream.getvalue()


def test_every_page_has_its_commands(said):
    assert [len(texts) for texts in said.values()] == [1, 1, 2, 2, 2]


def worst(text):
    row = next(line for line in text.splitlines() if line.strip().startswith("Least squares"))
    return [float(number) for number in re.findall(r"-?\d+\.\d+", row)]


def test_the_worst_error_is_the_one_that_the_tutorial_shows(said):
    told, found = worst(page("2_read")), worst(said["2_read"][0])
    assert told[2:5] == found[2:5] == [30.0, 60.0, 100.0]
    assert found[0] == pytest.approx(told[0], abs=0.1)
    assert found[5:8] == pytest.approx(told[5:8], abs=0.1)


def test_the_hidden_fault_is_named(said):
    text = said["3_diagnose"][1]
    first = "NAMED: The model lacks backlash of X; with that, model and run agree."
    assert text.startswith(first)
    assert first in page("3_diagnose")
    size = re.search(r"backlash of X +(\S+) ±", text)
    assert float(size[1]) == pytest.approx(0.80, abs=0.02)


def rows(text):
    """Return first and second figure of the rows that begin with a name of two words."""
    found = re.findall(
        r"^ (volume, \w+) +(?:µm +)?(\S+)(?: µm| ± \S+) +(?:< )?(\S+)", text, re.MULTILINE
    )
    return {name: (float(first), float(second)) for name, first, second in found}


@pytest.mark.parametrize("number", [0, 1], ids=["linuxcnc", "generic"])
def test_the_tables_leave_what_the_tutorial_says(said, number):
    told = page("4_compensate").split("```sh")[1 + number]
    assert rows(told)
    for name, (before, after) in rows(told).items():
        found = rows(said["4_compensate"][number])[name]
        assert found == pytest.approx((before, after), abs=0.1)


def test_the_second_measurement_is_as_much_better_as_the_tutorial_says(said):
    told, found = rows(page("5_again")), rows(said["5_again"][1])
    assert found["volume, worst"][0] == pytest.approx(told["volume, worst"][0], abs=0.1)
    assert told["volume, worst"][1] < 0.15
    assert found["volume, worst"][1] < 0.15
    assert "times better" in said["5_again"][1]
