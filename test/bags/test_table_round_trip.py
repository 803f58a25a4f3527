"""Bag → export → import: the same measurement, whatever the plan and however the run went."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from refused import a_fault, refused

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.export import export_bag
from stepdiag_ros.bags.imports.imported import ImportOptions
from stepdiag_ros.bags.imports.mapping import mapping_of
from stepdiag_ros.bags.imports.registry import import_file
from stepdiag_ros.bags.imports.writing import ToWrite, write_bag
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.table import import_table, read_table
from stepdiag_ros.bags.table_rows import ENVIRONMENT_COLUMNS
from stepdiag_ros.configuration import cell_from_text, find, read_text
from stepdiag_ros.evaluation.solving import solve_reproducibly
from stepdiag_ros.metrology.geometry import CHAINS, move_orders
from stepdiag_ros.metrology.plan import DIAGONAL, LINE_NAMES, LINEAR, STEP_DIAGONAL, Plan
from stepdiag_ros.metrology.plausible import ROTATIONS_KEY
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate

FIELDS = ("line", "line_index", "attempt", "setup")
ARRAYS = ("time", "target", "displacement", "standard_uncertainty", "environment", "overrun")
# Curves for every place that a plan below may have.
CELL = cell_from_text(
    read_text(find("demo", "cells"))
    .replace("travel_low_m: [0.0, 0.0, 0.0]", "travel_low_m: [-0.3, -0.3, -0.3]")
    .replace("travel_high_m: [0.12, 0.12, 0.12]", "travel_high_m: [0.8, 0.8, 0.8]"),
    "demo with long axes",
)
assert CELL.errors.nodes[0][-1] == 0.8
NAN = float("nan")


def some(values, largest):
    return st.lists(st.sampled_from(values), min_size=1, max_size=largest, unique=True)


@st.composite
def groups(draw):
    kind = draw(st.sampled_from([LINEAR, STEP_DIAGONAL, DIAGONAL]))
    group = {"kind": kind, "names": draw(some(LINE_NAMES[kind], 2))}
    if kind == STEP_DIAGONAL:
        # A group that names several diagonals gives each the orders of its own axes.
        known = [move_orders(name) for name in group["names"]]
        group["orders"] = list(
            dict.fromkeys(one for orders in known for one in draw(some(orders, 2)))
        )
    if kind == LINEAR and draw(st.booleans()):
        group["offset_m"] = draw(st.sampled_from([[0.0, 0.01, 0.0], [0.02, 0.0, 1 / 30]]))
    if draw(st.booleans()):
        group["mirror_offset_m"] = draw(st.sampled_from([[0.0, 0.1, 0.0], [-0.05, 0.0, 1 / 30]]))
    if draw(st.booleans()):
        group["repeats"] = draw(st.integers(1, 2))
    if draw(st.booleans()):
        group["directions"] = draw(some(["forward", "backward"], 2))
    return group


@st.composite
def plans(draw):
    plan = {
        "name": draw(st.sampled_from(["Abnahme, Halle 3", "imported from run.csv", "yes"])),
        "origin_m": [draw(st.sampled_from([0.0, -0.1, 1 / 3])) for _ in range(3)],
        "step_m": [draw(st.sampled_from([0.01, 0.02, 1 / 70])) for _ in range(3)],
        "blocks": draw(st.integers(1, 3)),
        "feed_m_per_s": draw(st.sampled_from([0.033, "unknown"])),
        "lines": draw(st.lists(groups(), min_size=1, max_size=4)),
    }
    optional = {
        "repeats": st.integers(1, 2),
        "directions": some(["forward", "backward"], 2),
        "pause_for_setup": st.booleans(),
        "one_alignment_per_diagonal": st.booleans(),
        "overrun_m": st.sampled_from([0.0, 0.002]),
        "sampling": st.just({"dwell_s": 1.5, "window_s": 0.25, "after_attempts": "leave"}),
    }
    return {**plan, **{key: draw(one) for key, one in optional.items() if draw(st.booleans())}}


@st.composite
def runs(draw):
    """Return a plan's text, and the lines of a run by it with all that can happen in one."""
    written = draw(plans())
    plan = Plan.from_mapping(written, "plan")
    if np.isnan(plan.feed):
        plan = replace(plan, feed=0.03)
    lines = list(simulate(plan, CELL, seed=draw(st.integers(0, 99))).lines)
    lines = lines[: draw(st.integers(1, len(lines)))]  # a run may be cut short
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    if draw(st.booleans()):  # stops that were rejected
        line = draw(st.integers(0, len(lines) - 1))
        rejected = rng.random(len(lines[line].displacement)) < 0.3
        displacement = np.where(rejected, NAN, lines[line].displacement)
        lines[line] = replace(lines[line], displacement=displacement)
    if draw(st.booleans()):  # a line that was measured again, in another alignment
        line = draw(st.integers(0, len(lines) - 1))
        usual = f"{lines[line].setup} #2"
        setup = draw(st.sampled_from([usual, "=1+1", "'=1", "@x", "-1", "''+1", "' '"]))
        lines[line] = replace(lines[line], attempt=3, setup=setup)
    sigma = draw(st.sampled_from(["each", "one", "unknown", "some"]))
    overrun = draw(st.sampled_from(["plan", "unknown", "other"]))
    without = draw(st.booleans())
    made = []
    for place, line in enumerate(lines):
        count = len(line.time)
        values = {
            "each": 1e-8 * (1.0 + rng.random(count)),
            "one": np.full(count, 3e-8),
            "unknown": np.full(count, NAN),
            "some": np.full(count, NAN if place % 2 else 3e-8),
        }
        begun = {"plan": line.overrun, "unknown": NAN, "other": 0.001 * (place % 2)}[overrun]
        environment = np.where(rng.random((count, 4)) < 0.2, NAN, line.environment)
        made.append(
            replace(
                line,
                standard_uncertainty=values[sigma],
                overrun=begun,
                environment=environment,
                time=np.full(count, NAN) if without else line.time,
                end_time=place if without else line.end_time,
            )
        )
    return yaml.safe_dump(written), tuple(made)


def write(path, plan, lines, chain, rotations=None):
    machine = {"name": "Portal 4"}
    machine |= {"chain": list(chain)} if chain else {}
    machine |= {} if rotations is None else {ROTATIONS_KEY: rotations}
    text = yaml.safe_dump(machine)
    write_bag(path, ToWrite("r", "a plan", "none", plan, text, lines=lines))


def same(one, other):
    for name in FIELDS:
        assert getattr(one, name) == getattr(other, name), name
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def without_feed(plan):
    return replace(plan, feed=0.0 if np.isnan(plan.feed) else plan.feed)


@settings(max_examples=60, suppress_health_check=list(HealthCheck))
@given(made=runs(), chain=st.sampled_from(["", *CHAINS]))
def test_every_run_comes_back_from_its_tables(made, chain):
    plan, lines = made
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(folder / "a.mcap", plan, lines, chain)
        report = export_bag(folder / "a.mcap", folder / "out")
        assert not any("cannot be imported" in remark for remark in report.remarks)
        import_table(folder / "out" / "run.csv", None, folder / "b.mcap")
        before, after = load_run(folder / "a.mcap"), load_run(folder / "b.mcap")
        assert without_feed(after.plan) == without_feed(before.plan)
        assert after.chain == before.chain
        assert after.machine["name"] == "Portal 4"
        first, again = before.measurement, after.measurement
        assert first.volume == again.volume
        for one, other in zip(first.lines, again.lines, strict=True):
            same(one, other)


@pytest.mark.parametrize("stated", [None, "large_machine", 0.0])
def test_the_size_of_rotations_comes_back_if_it_was_stated(tmp_path, stated):
    plan = yaml.safe_load(read_text(find("quick", "plans")))
    lines = simulate(Plan.from_mapping(plan, "plan"), CELL).lines
    write(tmp_path / "a.mcap", yaml.safe_dump(plan), lines, "YXZ", stated)
    export_bag(tmp_path / "a.mcap", tmp_path / "out")
    import_table(tmp_path / "out" / "run.csv", None, tmp_path / "b.mcap")
    before, after = load_run(tmp_path / "a.mcap"), load_run(tmp_path / "b.mcap")
    assert after.measurement.plausible == before.measurement.plausible
    assert (ROTATIONS_KEY in after.machine) == (stated is not None)


@pytest.mark.parametrize("name", ["ibaraki_hata_2010", "move_orders", "iso230_6_face", "kimm"])
def test_the_same_curves_to_the_bit(tmp_path, name):
    text = read_text(find(name, "plans"))
    parsed = {**yaml.safe_load(text), "blocks": 3}
    plan = Plan.from_mapping(parsed, name)
    write(tmp_path / "a.mcap", yaml.safe_dump(parsed), simulate(plan, CELL).lines, "YXZ")
    export_bag(tmp_path / "a.mcap", tmp_path / "out")
    import_table(tmp_path / "out" / "run.csv", None, tmp_path / "b.mcap")
    solved = [
        solve_reproducibly(load_run(tmp_path / bag).measurement) for bag in ("a.mcap", "b.mcap")
    ]
    (first, refused), (again, refused_again) = solved
    assert refused == refused_again
    assert first.keys() == again.keys()
    for method, result in first.items():
        for curve, values in result.curves.items():
            np.testing.assert_array_equal(again[method].curves[curve], values)
            np.testing.assert_array_equal(
                again[method].standard_uncertainty[curve], result.standard_uncertainty[curve]
            )


@pytest.fixture
def exported(tmp_path):
    """Return the folder of an exported run with one alignment for all orders of a diagonal."""
    parsed = {**yaml.safe_load(read_text(find("ibaraki_hata_2010", "plans"))), "blocks": 2}
    lines = simulate(Plan.from_mapping(parsed, "plan"), CELL).lines[:-6]  # cut short
    write(tmp_path / "a.mcap", yaml.safe_dump(parsed), lines, "YXZ")
    export_bag(tmp_path / "a.mcap", tmp_path / "out")
    return tmp_path / "out"


def test_one_alignment_is_told_by_a_key_of_the_case_file_alone(exported):
    told = yaml.safe_load((exported / "case.yaml").read_text())
    kept = {key: told[key] for key in ("origin_m", "step_m", "blocks")}
    setups = {}
    for flag in (True, False):
        case = {**kept, "one_alignment_per_diagonal": flag}
        (exported / "case.yaml").write_text(yaml.safe_dump(case))
        setups[flag] = {line.setup for line in read_table(exported / "run.csv").lines}
    assert {"ppp", "npp", "pnp", "x", "y", "z"} == setups[True]
    assert {"ppp XYZ", "ppp YZX", "ppp ZXY"} < setups[False]


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (
            "one_alignment_per_diagonal",
            "one_aligment_per_diagonal",
            a_fault("unknown", "one_alignment_per_diagonal", about="one_aligment_per_diagonal"),
        ),
        (
            "dwell_s",
            "dwel_s",
            a_fault("unknown", "dwell_s", about="dwel_s"),
        ),
        ("blocks", "block", a_fault("missing", about="blocks")),
        (
            "pause_for_setup: true",
            "pause_for_setup: perhaps",
            a_fault("malformed", about="pause_for_setup"),
        ),
        ("names: [x, y, z]", "names: [x, z]", a_fault("mismatch", "y", row=17)),
    ],
)
def test_a_wrong_key_of_the_plan_is_refused(exported, old, new, reason):
    path = exported / "case.yaml"
    text = yaml.safe_dump(yaml.safe_load(path.read_text()), default_flow_style=None)
    assert old in text
    path.write_text(text.replace(old, new))
    with refused(TableError, reason):
        read_table(exported / "run.csv")


MAPPING = {
    "table": "lines",
    "text": {"rejected": ""},
    "columns": {
        "line": "line",
        "order": "order",
        "run": "repeat",
        "direction": "direction",
        "stop": "stop",
        "time": "time_s",
        "reading": "reading_m",
        "x": "x_m",
        "y": "y_m",
        "z": "z_m",
        "setup": "setup",
        "attempt": "attempt",
        "overrun": "overrun_m",
        "uncertainty": "standard_uncertainty_m",
        **{name: name for name in ENVIRONMENT_COLUMNS},
    },
    "units": {
        "time": "s",
        **dict.fromkeys(("reading", "x", "y", "z", "overrun", "uncertainty"), "m"),
    },
}


def test_a_mapping_file_tells_the_plan_and_all_that_the_solve_needs(tmp_path):
    parsed = {**yaml.safe_load(read_text(find("ibaraki_hata_2010", "plans"))), "blocks": 2}
    lines = list(simulate(Plan.from_mapping(parsed, "plan"), CELL).lines)
    rng = np.random.default_rng(1)
    for place, line in enumerate(lines):
        lines[place] = replace(
            line,
            overrun=0.001 * (place % 2),
            standard_uncertainty=1e-8 * (1.0 + rng.random(len(line.time))),
        )
    lines[3].displacement[1] = NAN
    lines[4] = replace(lines[4], attempt=2, setup="x, aligned anew")
    write(tmp_path / "a.mcap", yaml.safe_dump(parsed), lines, "YXZ")
    export_bag(tmp_path / "a.mcap", tmp_path / "out")
    course = {
        key: value
        for key, value in parsed.items()
        if key not in ("origin_m", "step_m", "blocks", "overrun_m")
    }
    box = {key: parsed[key] for key in ("origin_m", "step_m", "blocks")}
    mapping = {**MAPPING, "volume": box, "chain": ["Y", "X", "Z"], "plan": course}
    (tmp_path / "mapping.yaml").write_text(yaml.safe_dump(mapping))
    # The names of the columns are not known by content, as those of a run table are.
    options = ImportOptions(mapping=str(tmp_path / "mapping.yaml"))
    import_file(tmp_path / "out" / "run.csv", tmp_path / "b.mcap", options)
    before, after = load_run(tmp_path / "a.mcap"), load_run(tmp_path / "b.mcap")
    assert after.plan == before.plan
    assert after.chain == before.chain
    for one, other in zip(before.measurement.lines, after.measurement.lines, strict=True):
        same(one, other)


@pytest.mark.parametrize(
    ("where", "key", "fault"),
    [
        ("plan", "one_aligment_per_diagonal", "unknown"),
        ("plan", "overrun_m", "mismatch"),
        ("text", "x", "unknown"),
    ],
)
def test_a_wrong_key_of_a_mapping_is_refused(where, key, fault):
    mapping = {
        **MAPPING,
        "volume": {"origin_m": [0, 0, 0], "step_m": [1, 1, 1], "blocks": 1},
        where: {key: 0.5},
    }
    with refused(Refusal, fault, key):
        mapping_of(mapping, "mapping.yaml", "")


@pytest.mark.parametrize(
    ("box", "key"),
    [({"origin_m": [500, 500, -300]}, "origin_m"), ({"step_m": [30, 30, 30]}, "step_m")],
)
def test_a_box_in_millimetres_is_refused_and_answered_in_metres(box, key):
    volume = {"origin_m": [0, 0, 0], "step_m": [1, 1, 1], "blocks": 1, **box}
    with refused(Refusal, "out_of_range", about=key) as caught:
        mapping_of({**MAPPING, "volume": volume}, "mapping.yaml", "")
    assert {"mm", f"{box[key][0] / 1000:g}"} <= set(str(caught.value).split())


def test_a_run_on_nodes_comes_back_from_its_tables(tmp_path):
    bag = Path(__file__).parents[2] / "docs" / "examples" / "small_run.mcap"
    export_bag(bag, tmp_path / "out")
    import_table(tmp_path / "out" / "run.csv", None, tmp_path / "b.mcap")
    before, after = load_run(bag), load_run(tmp_path / "b.mcap")
    assert after.plan == before.plan
    assert after.machine["name"] == before.machine["name"]
    assert after.simulated_cell == before.simulated_cell != ""
    for one, other in zip(before.measurement.lines, after.measurement.lines, strict=True):
        same(one, other)
