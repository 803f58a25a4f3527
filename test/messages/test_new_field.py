"""A field of a message is added in its definition and in its data class; all else follows.

That is done to a copy of the package, which then runs in a process of its own.
"""

import csv
import json
import os
import subprocess
import sys
from pathlib import Path
from shutil import copytree, ignore_patterns

import pytest
from patience import PATIENCE

ROOT = Path(__file__).parents[2]
RUN = ROOT / "docs" / "examples" / "small_run.mcap"
ADDED = {
    "BlockDisplacement": (
        "class BlockDisplacement:",
        "    standard_uncertainty: Metres\n",
        (("wobble", "float64", "Metres", "float('nan')"), ("echoes", "uint32", "int", "0")),
    ),
    "SettledStop": (
        "class SettledStop:",
        "    environment: Environment\n",
        (
            ("knock", "float64", "Metres", "0.5"),
            ("note", "string", "str", "''"),
            ("bend", "float64[3]", "tuple[float, float, float]", "(0.0, 0.0, 0.0)"),
        ),
    ),
}
"""Message → where its data class begins, its last field, and fields behind it."""
ROUND_TRIP = """
import json
import sys
from dataclasses import replace

import stepdiag_ros
from stepdiag_ros import open_run
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.embedded import registry
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.types import new_message

run = open_run(sys.argv[1])
block = replace(run.blocks[3], wobble=0.125, echoes=7)
stop = replace(run.stops[3], knock=-2.0, note="drops", bend=(1.0, 2.0, 3.0))
said = {"from": stepdiag_ros.__file__, "before": [repr(run.blocks[3].wobble), run.stops[3].knock]}
for name, value, made, read in (
    ("block", block, conversion.from_block, conversion.to_block),
    ("stop", stop, conversion.from_settled_stop, conversion.to_settled_stop),
):
    kind = f"stepdiag_ros/msg/{type(value).__name__}"
    sent = own_types().encode(kind, made(value, "run", own_types().new))
    live = made(value, "run", new_message)
    said[name] = [
        read(own_types().decode(kind, sent)) == value,
        read(live) == value,
        own_types().encode(kind, live) == sent,
    ]
print(json.dumps(said))
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """Copy the package, add the fields, and return the folder."""
    folder = tmp_path_factory.mktemp("copy")
    for name in ("stepdiag_ros", "msg", "action", "config"):
        copytree(ROOT / name, folder / name, ignore=ignore_patterns("__pycache__"))
    classes = folder / "stepdiag_ros" / "metrology" / "measurement.py"
    for message, (begin, last, fields) in ADDED.items():
        definition = folder / "msg" / f"{message}.msg"
        text = definition.read_text(encoding="utf-8")
        for name, kind, _, _ in fields:
            text += f"{kind} {name}  # added\n"
        definition.write_text(text, encoding="utf-8")
        declared = "".join(f"    {name}: {kind} = {one}\n" for name, _, kind, one in fields)
        before, head, after = classes.read_text(encoding="utf-8").partition(begin)
        classes.write_text(before + head + after.replace(last, last + declared, 1))
    return folder


def _python(folder, *arguments):
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1"},
        timeout=PATIENCE,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_it_goes_out_and_comes_back_and_bags_without_it_are_read(package):
    said = json.loads(_python(package, "-c", ROUND_TRIP, RUN))
    assert Path(said["from"]).is_relative_to(package)
    assert said["before"] == ["nan", 0.5]
    assert said["block"] == said["stop"] == [True, True, True]


def test_tables_have_a_column_for_it_that_names_its_unit(package, tmp_path):
    _python(package, "-m", "stepdiag_ros.cli", "export", RUN, "--output", tmp_path)
    blocks, stops = (
        list(csv.DictReader((tmp_path / f"{name}.csv").open(encoding="utf-8")))
        for name in ("blocks", "stops")
    )
    assert {(row["wobble_m"], row["echoes"]) for row in blocks} == {("", "0")}
    assert {(row["knock_m"], row["note"]) for row in stops} == {("0.5", "")}
