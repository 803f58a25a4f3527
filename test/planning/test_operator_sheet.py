"""The sheet beside an NC program leads through the alignments; by-hand takes its recordings."""

import re
import shlex

import pytest

from stepdiag_ros.bags.hand_run import lines_of_recordings
from stepdiag_ros.commands.by_hand import COMMAND
from stepdiag_ros.configuration import load_machine, load_plan
from stepdiag_ros.planning.duration import duration
from stepdiag_ros.planning.moves import passes_of
from stepdiag_ros.planning.operator_sheet import operator_sheet

PLANS = ("demo", "quick", "move_orders", "two_axes", "iso230_2", "kimm")


@pytest.fixture(scope="module")
def machine():
    return load_machine("demo")[0]


def sheet_of(plan, machine):
    return operator_sheet(plan, machine, "the_plan.nc", "the_plan.yaml")


@pytest.mark.parametrize("name", PLANS)
def test_each_alignment_has_an_entry_with_its_passes_stops_and_file(name, machine):
    plan = load_plan(name)[0]
    sheet = " ".join(sheet_of(plan, machine).split())
    begins = [n for n, one in enumerate(passes_of(plan), start=1) if one.new_setup]
    files = list(dict.fromkeys(re.findall(r"the_plan_\w+\.csv", sheet)))
    assert len(files) == len(begins)
    recorded = lines_of_recordings(plan, len(files))
    assert [one[0] + 1 for one in recorded] == begins, "by-hand takes a file for each entry"
    stops = [int(found) for found in re.findall(r" (\d+) stops, ", sheet)]
    assert sum(stops) == plan.stop_count and len(stops) == len(begins)
    for one in recorded:
        passes = f"passes {one[0] + 1} to {one[-1] + 1}" if len(one) > 1 else f"pass {one[0] + 1}"
        assert f"{passes} of {len(plan.lines)}" in sheet


def test_the_time_of_the_entries_is_that_of_the_plan(machine):
    plan = load_plan("demo")[0]
    sheet, taken = " ".join(sheet_of(plan, machine).split()), duration(plan, machine)
    found = re.findall(r"stops, ([\d.]+) min(?:, after ([\d.]+) min)?", sheet)
    assert sum(float(one) for one, _ in found) * 60.0 == pytest.approx(taken.running, abs=60.0)
    assert sum(float(one or 0.0) for _, one in found) * 60.0 == pytest.approx(taken.alignment)


def test_the_change_to_check_is_the_way_along_the_beam(machine):
    plan = load_plan("quick")[0]
    sheet = sheet_of(plan, machine)
    changes = [float(one) for one in re.findall(r"reading by\s+([-+][\d.]+) mm", sheet)]
    side = plan.volume.step[0] * plan.volume.blocks * 1e3
    assert changes == pytest.approx([side] * 3 + [3.0**0.5 * side] * 3, abs=1e-3)


@pytest.mark.parametrize("name", PLANS)
def test_the_command_at_its_end_is_one(name, machine):
    import argparse

    sheet = sheet_of(load_plan(name)[0], machine)
    command = shlex.split(sheet[sheet.index("stepdiag by-hand") :])
    parser = argparse.ArgumentParser()
    COMMAND.add_options(parser)
    given = parser.parse_args(command[2:])
    assert given.plan == "the_plan.yaml" and given.recordings
    assert max(map(len, sheet.splitlines())) <= 80
