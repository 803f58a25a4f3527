"""Tables of directly measured errors, and those made from files of Renishaw's laser software."""

import hashlib

import numpy as np
import pytest
from refused import a_fault, refused

from stepdiag_ros import cli
from stepdiag_ros.bags.direct_table import load_direct
from stepdiag_ros.metrology.direct import direct_text
from stepdiag_ros.metrology.direct_reading import read_direct

TARGETS = (0.0, 10.0, 20.0, 30.0, 40.0)
ARC_SECOND = np.pi / 648000.0


def deviation(run, target):
    return 0.5 * target + 0.01 * run


def renishaw(path, kind="Angular", axis="X", runs=(1, 2), decimal="."):
    """Write a file of an angular or straightness test, every second run backwards."""
    rows = []
    for run in runs:
        order = range(1, 6) if run % 2 else range(5, 0, -1)
        rows += [f"{run} {target} {deviation(run, target):.3f}" for target in order]
    lines = ["HEADER::", f"File type: {kind}", "Owner: Renishaw plc", "", "TARGET DATA::"]
    lines += ["Target-count: 5", "Targets :", " ".join(map(str, TARGETS)), "Flags: 0", ""]
    lines += ["USER-TEXT::", "Machine: Fräse", f"Axis: {axis}", "", "RUNS::"]
    lines += [f"Run-count: {len(runs)}", "", "DEVIATIONS::", "Run Target Data:", *rows, ""]
    lines += ["EQUIPMENT::", f"Optics: {kind}", "", "EOF::"]
    text = "\r\n".join(lines).replace(".", decimal) if decimal != "." else "\r\n".join(lines)
    path.write_bytes((text + "\r\n").encode("cp1252"))
    return path


def convert(path, *options, curve="E_BX", unit="arcsec", uncertainty="0.2"):
    wanted = ["--curve", curve, "--unit", unit, "--uncertainty", uncertainty]
    return cli.main(["direct", str(path), *wanted, *options])


def test_a_table_is_made_that_reads_back_as_what_was_measured(tmp_path):
    path = renishaw(tmp_path / "pitch.rta")
    assert convert(path) == 0
    table = tmp_path / "pitch_E_BX.csv"
    direct = load_direct([table])
    curve = direct.curves["E_BX"]
    np.testing.assert_allclose(curve.positions, 1e-3 * np.array(TARGETS))
    expected = [[ARC_SECOND * deviation(run, k) for k in range(1, 6)] for run in (1, 2)]
    np.testing.assert_allclose(curve.values, expected, rtol=1e-12)
    np.testing.assert_allclose(curve.stated_uncertainty, 0.2 * ARC_SECOND)
    assert np.all(np.isnan(curve.place.standing)) and curve.place.reflector == (0.0, 0.0, 0.0)
    assert direct.files == (
        (str(table), hashlib.sha256(table.read_bytes()).hexdigest(), ("E_BX",)),
    )
    assert any(hashlib.sha256(path.read_bytes()).hexdigest() in note for note in direct.notes)
    again = read_direct(direct_text(direct), "again")
    np.testing.assert_array_equal(again.curves["E_BX"].values, curve.values)
    assert again.notes == direct.notes


def test_where_it_was_measured_goes_into_the_table(tmp_path):
    path = renishaw(tmp_path / "side.rts", "Straightness")
    place = ["--standing", "0", "150", "80", "--reflector", "-5", "0", "12.5"]
    assert convert(path, *place, curve="E_YX", unit="um", uncertainty="0.1") == 0
    curve = load_direct([tmp_path / "side_E_YX.csv"]).curves["E_YX"]
    assert curve.place.standing == pytest.approx((0.0, 0.15, 0.08))
    assert curve.place.reflector == pytest.approx((-0.005, 0.0, 0.0125))
    assert curve.values[0, 0] == pytest.approx(1e-6 * deviation(1, 1))


def test_decimal_commas_are_read_where_they_are_said(tmp_path, capsys):
    path = renishaw(tmp_path / "pitch.rta", decimal=",")
    assert convert(path) == 1
    assert "--decimal" in capsys.readouterr().err
    assert convert(path, "--decimal", ",") == 0


@pytest.mark.parametrize(
    ("name", "kind", "axis", "curve", "unit"),
    [
        ("a.rta", "Angular", "X", "E_YX", "um"),
        ("a.rts", "Straightness", "X", "E_BX", "urad"),
        ("a.rtl", "Linear", "X", "E_YX", "um"),
        ("a.txt", "Angular", "X", "E_YX", "um"),
        ("a.txt", "Straightness", "X", "E_XX", "um"),
        ("a.rta", "Angular", "Y-Axis", "E_BX", "urad"),
        ("a.rta", "Angular", "X", "E_BX", "um"),
        ("a.rts", "Straightness", "X", "E_YX", "arcsec"),
        ("a.rta", "Angular", "X", "E_BX", "rad"),
    ],
)
def test_what_the_file_tells_must_agree_with_what_the_user_says(
    tmp_path, capsys, name, kind, axis, curve, unit
):
    path = renishaw(tmp_path / name, kind, axis)
    try:
        assert convert(path, curve=curve, unit=unit) == 1
    except SystemExit as refused:
        assert refused.code == 2
    said = capsys.readouterr().err
    assert "Traceback" not in said and said.strip()
    assert [one.name for one in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("1 3 1.510\r\n", ""),
        ("1 3 1.510\r\n", "1 2 1.510\r\n"),
        ("1 3 1.510\r\n", "1 3 1.5x\r\n"),
        ("1 3 1.510\r\n", "1 9 1.510\r\n"),
        ("1 3 1.510\r\n", "1 3 99999999\r\n"),
        ("Target-count: 5", "Target-count: 6"),
        ("Run-count: 2", "Run-count: 3"),
        ("HEADER::", "NOTHING"),
        ("DEVIATIONS::", "SOMETHING"),
    ],
)
def test_a_damaged_file_is_refused_with_its_name_and_nothing_is_written(tmp_path, capsys, old, new):
    path = renishaw(tmp_path / "pitch.rta")
    data = path.read_bytes()
    assert old.encode() in data
    path.write_bytes(data.replace(old.encode(), new.encode(), 1))
    assert convert(path) == 1
    assert "pitch.rta" in capsys.readouterr().err
    assert [one.name for one in tmp_path.iterdir()] == ["pitch.rta"]


def test_a_table_is_not_overwritten(tmp_path, capsys):
    path = renishaw(tmp_path / "pitch.rta")
    (tmp_path / "pitch_E_BX.csv").write_text("mine")
    assert convert(path) == 1
    assert (tmp_path / "pitch_E_BX.csv").read_text() == "mine"
    assert "--output" in capsys.readouterr().err


def test_files_that_hold_the_same_error_or_are_no_tables_are_refused(tmp_path):
    path = renishaw(tmp_path / "pitch.rta")
    assert convert(path) == 0
    table = tmp_path / "pitch_E_BX.csv"
    for wrong, names in (
        ([table, table], a_fault("twice", "E_BX")),
        ([path], a_fault("wrong_kind", "pitch.rta")),
        ([tmp_path / "nothing.csv"], a_fault("not_found", "nothing.csv")),
        ([tmp_path], a_fault("unreadable")),
    ):
        with refused(ValueError, names):
            load_direct(wrong)
    assert load_direct([]) is None
