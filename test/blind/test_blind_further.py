"""What the blind test's machine does beyond one run: proposed plans, other days, gross errors."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from blind_cases import draw_case, own_limits, write_case, write_further, write_gross
from blind_effects import Hidden
from blind_gross import GROSS, OF_THE_TABLE, OUTLIER, draw_gross
from blind_kinematics import Action
from blind_machine import Machine
from blind_plans import draw_plan, make_run, plan_of_file
from blind_tables import case_text, table_text
from refused import refused

PLAN = """
name: everything that a plan file can say
origin_m: [0.0, 0.0, 0.0]
step_m: [{step}]
blocks: {blocks}
repeats: 2
directions: [forward, backward]
feed_m_per_s: 0.05
overrun_m: 0.002
one_alignment_per_diagonal: {one_alignment}
lines:
  - {{kind: linear, names: [x], offset_m: [0.0, 0.04, 0.0], repeats: 1, directions: [forward]}}
  - {{kind: linear, names: [x]}}
  - {{kind: linear, names: [x], mirror_offset_m: [0.0, 0.1, 0.0]}}
  - {{kind: step_diagonal, names: [npp, ppn], orders: [XYZ, ZYX], repeats: 1}}
  - {{kind: step_diagonal, names: [ppn], mirror_offset_m: [0.1, 0.0, 0.0]}}
  - {{kind: diagonal, names: [pp0], offset_m: [0.0, 0.0, 0.03], repeats: 1}}
sampling: {{dwell_s: 1.5, settle_s: 0.4, window_s: 0.6}}
"""


def some_plan(seed=3):
    return draw_plan(np.random.default_rng(seed), rich=True)


def plan_text(before, one_alignment=False):
    return PLAN.format(
        step=", ".join(map(repr, before.step)),
        blocks=before.blocks,
        one_alignment=str(one_alignment).lower(),
    )


def further_run(before, one_alignment=False):
    text = plan_text(before, one_alignment)
    return make_run(plan_of_file(text, before, np.random.default_rng(0)))


@pytest.mark.parametrize("one_alignment", [False, True])
def test_a_plan_file_is_measured_as_the_project_itself_reads_it(one_alignment):
    import yaml

    from stepdiag_ros.metrology.plan import Plan

    before = some_plan()
    run = further_run(before, one_alignment)
    plan = Plan.from_mapping(yaml.safe_load(plan_text(before, one_alignment)), "test")
    expected = np.concatenate([line.stops(plan.volume) for line in plan.lines])
    np.testing.assert_allclose(run.position, expected, atol=1e-12)
    assert run.plan.stops == plan.stop_count
    setups = [plan.setup_of(line) for line in plan.lines for _ in line.stops(plan.volume)]
    told = dict(zip(run.setup, setups, strict=True))
    assert [told[number] for number in run.setup] == setups
    assert len(told) == len(set(setups)) == (7 if one_alignment else 9)
    kinds = [(line.kind, line.name, line.order, line.direction) for line in plan.lines]
    passes = np.flatnonzero(run.number == 0)
    rows = [(row[0], row[1], row[2], row[4]) for row in (run.rows[place] for place in passes)]
    assert rows == kinds


def test_passes_that_stand_beside_each_other_are_told_apart_by_their_repeats():
    run = further_run(some_plan())
    begins = np.flatnonzero(run.number == 0)
    words = [(*run.rows[place][:5], *run.mirror[place]) for place in begins]
    assert len(set(words)) == len(words)


@pytest.mark.parametrize("one_alignment", [False, True])
def test_a_mirror_mounted_elsewhere_reaches_the_workflow_by_the_table(tmp_path, one_alignment):
    from stepdiag_ros.bags.table import load_table
    from stepdiag_ros.metrology.effects.stops import stops_of

    run = further_run(some_plan(), one_alignment)
    (tmp_path / "run.csv").write_text(table_text(run, run.along))
    (tmp_path / "case.yaml").write_text(case_text(run.plan))
    measurement = load_table(tmp_path / "run.csv").measurement
    np.testing.assert_array_equal(stops_of(measurement).mirror_offset, run.mirror)
    assert np.count_nonzero(np.ptp(run.mirror, axis=0)) == 2


def test_stops_take_the_dwell_and_the_way_at_the_feed():
    before = some_plan()
    run = further_run(before)
    pause = np.diff(run.time)
    inside = run.number[1:] > 0
    way = np.linalg.norm(run.way[1:], axis=1)
    np.testing.assert_allclose(pause[inside], 1.5 + way[inside] / 0.05)
    aligned = np.diff(run.setup) > 0
    assert pause[aligned].min() >= before.setup_time


def test_a_run_up_brings_every_pass_of_a_line_to_its_first_stop_in_its_own_sense():
    run = further_run(some_plan())
    begins = (run.number == 0) & (np.array([row[0] for row in run.rows]) != "step_diagonal")
    after = np.flatnonzero(begins) + 1
    np.testing.assert_array_equal(run.came[begins], run.moved[after])


def test_another_box_is_not_measured():
    before = some_plan()
    other = replace(before, blocks=before.blocks + 1)
    with refused(ValueError, None, "11", "0.02"):
        plan_of_file(plan_text(other), before, np.random.default_rng(0))


def test_the_machine_is_the_same_on_another_day_and_all_else_is_not():
    plan = some_plan()
    first, second = Machine(5, plan), Machine(5, plan, day=1)
    np.testing.assert_array_equal(first.curves, second.curves)
    assert np.all(first.beam_tilt != second.beam_tilt)
    assert not np.any(first.lengths) and 0.1e-6 < np.abs(second.lengths).max() < 10e-6


def read(folder):
    with (folder / "run.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def further_change(tmp_path, case, size):
    """What an effect of a case adds to the readings of a further run."""
    readings = [
        np.array(
            [
                float(row["reading_m"])
                for row in read(write_further(tmp_path / name, case, [one], plan_text(case.plan)))
            ]
        )
        for name, one in (("without", 0.0), ("with", size))
    ]
    return readings[1] - readings[0]


def test_effects_of_the_machine_act_again_and_those_of_an_alignment_do_not(tmp_path):
    case = draw_case("one", 2, largest=900)
    stays = replace(case, hidden=(Hidden("backlash", {"axis": "X"}),))
    change = further_change(tmp_path, stays, 20e-6)
    assert 15e-6 < np.ptp(change) < 40e-6
    for kind, further in (
        ("cosine", {}),
        ("slip", {"repeat": 0, "direction": "forward", "stop": 3}),
        ("mirror_tilt", {"angle": 0.3}),
        ("abbe", {"axis": "X"}),
    ):
        over = replace(case, hidden=(Hidden(kind, {"setup": 4, **further}),))
        assert not np.any(further_change(tmp_path, over, 20e-6)), kind


def test_both_runs_can_be_put_to_the_workflow_together(tmp_path):
    from blind_asking import _as_planned

    from stepdiag_ros.metrology.discrepancy.joint import joined

    case = draw_case("one", 2, largest=900)
    (size,) = own_limits(case)
    first = write_case(tmp_path / "first", case, [size])
    text = plan_text(case.plan, one_alignment=True)
    second = write_further(tmp_path / "second", case, [size], text)
    (second / "plan.yaml").write_text(text)
    both = [_as_planned(folder) for folder in (first, second)]
    setups = {line.setup for line in both[1].lines}
    assert {"npp", "ppn"} <= setups and not any("XYZ" in name for name in setups)
    together = joined(both)
    assert len(together.lines) == sum(len(one.lines) for one in both)


def test_every_gross_error_is_drawn_and_says_where():
    drawn = [draw_gross(np.random.default_rng(seed), some_plan()) for seed in range(150)]
    assert {one["kind"] for one in drawn} == set(GROSS)
    assert all(one["route"] == "table" for one in drawn if one["kind"] in OF_THE_TABLE)
    assert {one["route"] for one in drawn if one["kind"] == "sign"} == {"table", "measured"}


def gross_case(tmp_path, kind, **where):
    case = draw_case("gross", 1, largest=900)
    route = "table" if kind in OF_THE_TABLE else "measured"
    setup = next(n for n, one in enumerate(case.plan.setups) if one.order)
    gross = {"kind": kind, "route": route, "setup": setup, **where}
    right = write_case(tmp_path / "right", case, ())
    wrong = write_gross(tmp_path / "wrong", replace(case, gross=gross))
    return case, setup, read(right), read(wrong)


def change_of(right, wrong, name="reading_m"):
    return np.array([float(b[name]) - float(a[name]) for a, b in zip(right, wrong, strict=True)])


def test_a_reversed_axis_reads_the_other_way(tmp_path):
    case, _, right, wrong = gross_case(tmp_path, "reversed_axis", axis="Y")
    on_y = np.array([row["line"] == "y" for row in right])
    positions = np.array([float(row["y_m"]) for row in right])
    change = change_of(right, wrong)
    np.testing.assert_allclose(change[on_y], -2.0 * positions[on_y], atol=50e-6)
    assert np.abs(change[[row["line"] == "x" for row in right]]).max() < 1e-6
    assert np.abs(change_of(right, wrong, "y_m")).max() == 0.0
    assert case.plan.blocks > 0


def test_swapped_axes_leave_a_line_without_motion(tmp_path):
    _, _, right, wrong = gross_case(tmp_path, "swapped_axes", axis="X", other="Z")
    on_x = [row["line"] == "x" for row in right]
    readings = np.array([float(row["reading_m"]) for row in wrong])
    assert np.abs(readings[on_x]).max() < 100e-6
    assert np.abs(change_of(right, wrong)[[row["line"] == "y" for row in right]]).max() < 1e-6


@pytest.mark.parametrize(("kind", "other"), [("wrong_line", {"line": "pnp"}), ("wrong_order", {})])
def test_a_setup_under_a_wrong_name_differs_there_alone(kind, other, tmp_path):
    case = draw_case("gross", 1, largest=900)
    setup = next(one for one in case.plan.setups if one.order)
    other = other or {"order": setup.order[::-1]}
    _, number, right, wrong = gross_case(tmp_path, kind, **other)
    change = np.abs(change_of(right, wrong))
    here = Machine(case.seed, case.plan).run().setup == number
    assert change[here].max() > 1e-6 and change[~here].max() == 0.0


def test_what_is_done_to_readings_and_rows(tmp_path):
    *_, right, wrong = gross_case(tmp_path, "outlier", stop=5)
    change = change_of(right, wrong)
    assert np.count_nonzero(change) == 1 and change.max() == pytest.approx(OUTLIER)
    *_, wrong = gross_case(tmp_path, "inches")
    largest = max(float(row["reading_m"]) for row in right)
    assert max(float(row["reading_m"]) for row in wrong) == pytest.approx(largest / 0.0254)
    *_, wrong = gross_case(tmp_path, "repeated_row", stop=5)
    assert len(wrong) == len(right) + 1
    *_, wrong = gross_case(tmp_path, "lost_row", stop=5)
    assert len(wrong) == len(right) - 1
    *_, wrong = gross_case(tmp_path, "renamed_rows", line="ppp")
    assert {row["line"] for row in wrong} <= {row["line"] for row in right}
    *_, wrong = gross_case(tmp_path, "positions_in_mm")
    assert max(float(row["x_m"]) for row in wrong) > 10.0
    *_, wrong = gross_case(tmp_path, "turned_pass")
    turned = np.abs(change_of(right, wrong)) > 1e-3
    assert 0 < np.count_nonzero(turned) <= 3 * 15 + 1


def test_nothing_acts_where_nothing_is_hidden():
    run = further_run(some_plan())
    nothing = Action.none(len(run.time))
    both = nothing + nothing
    assert not np.any(both.shift) and not np.any(both.mirror) and not np.any(both.fringe)
