"""How the runs of an imported test began: told, told not to, or not known; and what follows."""

import math

import numpy as np
import pytest
import yaml
from import_files import DATA

from stepdiag_ros.bags.imports.imported import ImportOptions
from stepdiag_ros.bags.imports.registry import import_file, read_file
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.cli import main
from stepdiag_ros.configuration import find, read_text
from stepdiag_ros.metrology.discrepancy.diagnose import diagnose
from stepdiag_ros.metrology.discrepancy.findings import AMBIGUOUS, NAMED
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import STEP_DIAGONAL
from stepdiag_ros.metrology.standards.axis_test import STEPS_BEGIN_AT_THE_END, all_runs
from stepdiag_ros.metrology.standards.iso230_2 import evaluate

LOST_MOTION, NOISE = 1.5e-6, 0.1e-6
TARGETS = np.arange(0.0, 0.31, 0.03)


@pytest.fixture(params=[True, False], ids=["overrun", "no overrun"])
def table(request, tmp_path):
    """Return a table of X with lost motion, and whether its runs began beyond their ends."""
    rng = np.random.default_rng(5)
    rows = ["cycle,direction,target_mm,position_mm"]
    for cycle in range(1, 6):
        for direction, sense in (("forward", 1), ("backward", -1)):
            for place, target in enumerate(TARGETS[::sense]):
                # Without an overrun the axis turns round only after the first target.
                turned = request.param or place > 0
                error = (
                    2e-6 * math.sin(target / 0.06) - (sense if turned else -sense) * LOST_MOTION / 2
                )
                position = target + error + NOISE * rng.standard_normal()
                rows.append(f"{cycle},{direction},{1e3 * target:g},{1e3 * position:.7f}")
    path = tmp_path / "x.csv"
    path.write_text("\n".join(rows) + "\n")
    return path, request.param


def verdict(path, overrun):
    made = read_file(path, ImportOptions(axis="X", overrun=overrun))[1]
    found = diagnose(Measurement(made.volume, made.lines))
    return found, made.remarks


def test_what_nobody_tells_does_not_name_one_of_two_effects(table):
    path, _ = table
    found, remarks = verdict(path, math.nan)
    assert found.verdict == AMBIGUOUS
    (finding,) = found.findings
    assert {finding.candidate.label, *finding.group} == {"backlash of X", "settling of X"}
    assert any("--overrun" in remark for remark in remarks)


def test_what_is_told_is_taken_up(table):
    path, begun_beyond = table
    found, remarks = verdict(path, 0.002 if begun_beyond else 0.0)
    assert not any("--overrun" in remark for remark in remarks)
    if begun_beyond:
        # Every stop is reached in the sense of its run: both effects do the same.
        assert found.verdict == AMBIGUOUS
    else:
        assert found.verdict == NAMED
        assert [one.candidate.label for one in found.findings] == ["backlash of X"]
        assert found.findings[0].sizes["lost_motion"] == pytest.approx(LOST_MOTION, abs=0.1e-6)


@pytest.mark.parametrize(("told", "kept"), [(None, math.nan), (0.0, 0.0), (0.003, 0.003)])
def test_a_mapping_tells_it_and_the_bag_keeps_it(told, kept, tmp_path):
    parsed = yaml.safe_load(read_text(find("runs_in_columns", "imports")))
    if told is not None:
        parsed["overrun_m"] = told
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(yaml.safe_dump(parsed, allow_unicode=True), encoding="utf-8")
    bag = tmp_path / "a.mcap"
    import_file(
        DATA / "made_up_runs_in_columns.csv", bag, ImportOptions(axis="X", mapping=str(mapping))
    )
    lines = load_run(bag).lines
    np.testing.assert_array_equal([line.overrun for line in lines], [kept] * len(lines))


def test_the_command_line_goes_before_the_mapping(tmp_path, capsys):
    bag = tmp_path / "a.mcap"
    source = DATA / "made_up_runs_in_columns.csv"
    arguments = ["import", str(source), "--mapping", "runs_in_columns", str(bag)]
    assert main([*arguments, "--overrun", "0.002"]) == 0
    assert "reversal error" not in capsys.readouterr().err
    assert {line.overrun for line in load_run(bag).lines} == {0.002}


def test_where_mapped_lines_begin_is_unknown_unless_it_is_stated():
    _, made = read_file(
        DATA / "made_up_step_diagonal.txt", ImportOptions(mapping="step_diagonal_stops")
    )
    kinds = {line.line.kind for line in made.lines}
    assert STEP_DIAGONAL in kinds
    assert all(math.isnan(line.overrun) for line in made.lines)
    assert any("--overrun" in one for one in made.remarks)


@pytest.mark.parametrize(("overrun", "of_steps"), [(0.0, 0.0), (0.002, math.nan)])
def test_a_stated_overrun_that_does_not_apply_to_step_diagonals_is_named(overrun, of_steps):
    source = DATA / "made_up_step_diagonal.txt"
    _, made = read_file(source, ImportOptions(mapping="step_diagonal_stops", overrun=overrun))
    found = [line.overrun for line in made.lines if line.line.kind == STEP_DIAGONAL]
    np.testing.assert_array_equal(found, [of_steps] * len(found))
    assert any("step diagonals" in one for one in made.remarks) == (overrun > 0.0)
    (test, *_) = all_runs(Measurement(made.volume, made.lines))
    assert (STEPS_BEGIN_AT_THE_END in test.remarks) == (overrun == 0.0)


@pytest.mark.parametrize("of_steps", [0.0, 0.003])
def test_step_diagonals_have_a_key_of_their_own(tmp_path, of_steps):
    mapping = tmp_path / "mapping.yaml"
    parsed = yaml.safe_load(read_text(find("step_diagonal_stops", "imports")))
    parsed["overrun_of_step_diagonals_m"] = of_steps
    mapping.write_text(yaml.safe_dump(parsed, allow_unicode=True), encoding="utf-8")
    options = ImportOptions(mapping=str(mapping), overrun=0.002)
    _, made = read_file(DATA / "made_up_step_diagonal.txt", options)
    found = {line.overrun for line in made.lines if line.line.kind == STEP_DIAGONAL}
    assert found == {of_steps}


def test_b_of_iso_230_2_contains_all_targets_whatever_is_known_of_the_overrun(table):
    path, _ = table
    made = read_file(path, ImportOptions(axis="X"))[1]
    (runs,) = all_runs(Measurement(made.volume, made.lines))
    found = evaluate(runs)
    assert len(found.reversal) == len(TARGETS) and runs.ends_in_doubt
    assert found.parameters["mean B"] == np.mean(found.reversal)
    (said,) = (one for one in made.remarks if "--overrun" in one)
    assert "mean B" in said and "diagnosis" in said


def test_of_a_run_table_too_the_overrun_of_step_diagonals_is_named(tmp_path, capsys):
    table = DATA.parent / "cases" / "four_diagonals" / "run.csv"
    assert main(["import", str(table), str(tmp_path / "a.mcap"), "--overrun", "0.002"]) == 0
    assert "overrun" in capsys.readouterr().err
    assert main(["import", str(table), str(tmp_path / "b.mcap")]) == 0
    assert "overrun" not in capsys.readouterr().err


def test_of_uneven_targets_no_further_lines_are_asked_for(tmp_path, capsys):
    table = tmp_path / "x.csv"
    rows = [f"1,forward,{target},{target}" for target in (0, 10, 25)]
    table.write_text("\n".join(["cycle,direction,target_mm,position_mm", *rows]))
    assert main(["import", str(table), "--axis", "X"]) == 0
    assert "do not determine" not in capsys.readouterr().err
