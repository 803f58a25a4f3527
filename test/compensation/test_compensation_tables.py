"""Tables of controls, applied by controls: they make a simulated machine better, and how much."""

from dataclasses import replace

import numpy as np
import pytest
from control_doubles import DOUBLES
from machines_for_tables import along, measured, positioning, tool_errors
from refused import a_fault, refused

from stepdiag_ros.compensation import control, controls
from stepdiag_ros.compensation.applied import Beyond, ControlTable, TableSet
from stepdiag_ros.compensation.control import Layout, checked_settings
from stepdiag_ros.compensation.identified import Identified, reversal_of
from stepdiag_ros.compensation.remaining import remainder
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.standards.axis_test import BidirectionalRuns

TABLES = tuple(name for name in controls() if name != "generic")
ROUNDING = {"linuxcnc": 0.05e-9, "siemens": 5e-9, "heidenhain": 50e-9, "fanuc": 0.5e-6}
"""m: half of the last digit, or of the detection unit."""


def layout(name, spacing=0.0, reference=(0.0, 0.0, 0.0), **settings):
    return Layout(
        reference=reference, spacing=spacing, settings=checked_settings(control(name), settings)
    )


def written(name, identified, **options):
    return control(name).write(identified, layout(name, **options))


@pytest.mark.parametrize("name", TABLES)
def test_a_table_makes_positioning_better_by_what_rounding_leaves(name):
    cell, identified = measured()
    drive = DOUBLES[name](written(name, identified))
    for axis in range(3):
        places = along(identified, axis)
        before = positioning(cell, places, places, axis)
        after = positioning(cell, places, drive(places, +1), axis)
        # Rounding at both ends of the range, and what the measurement did not know.
        assert after < 2 * ROUNDING[name] + 25e-9, (name, axis, before, after)
        assert before > 4e-6 and before / after > (5 if name == "fanuc" else 40)


@pytest.mark.parametrize("name", ["siemens", "heidenhain"])
def test_tables_of_other_axes_make_the_volume_better(name):
    cell, identified = measured()
    drive = DOUBLES[name](written(name, identified))
    grid = identified.error_map.grid()[::7]
    before = np.linalg.norm(tool_errors(cell, grid, grid), axis=1)
    after = np.linalg.norm(tool_errors(cell, grid, drive(grid, +1)), axis=1)
    rms = np.sqrt(np.mean(before**2)), np.sqrt(np.mean(after**2))
    assert rms[0] > 3e-6 and rms[1] < 2 * ROUNDING[name] + 20e-9
    assert rms[0] / rms[1] > 20


@pytest.mark.parametrize("name", TABLES)
def test_what_is_read_back_is_what_the_control_does(name):
    _, identified = measured(lost_motion=2e-6)
    files = written(name, identified)
    drive, applied = DOUBLES[name](files), control(name).read(files)
    rng = np.random.default_rng(2)
    low, high = identified.error_map.low - 0.01, identified.error_map.high + 0.01
    places = rng.uniform(low, high, (200, 3))
    for sense in (+1, -1):
        assert applied.sent(places, sense > 0) == pytest.approx(drive(places, sense), abs=1e-12)


@pytest.mark.parametrize("name", TABLES)
def test_the_figures_of_what_remains_are_those_of_the_machine(name):
    cell, identified = measured()
    found = control(name)
    told = remainder(identified, found.read(written(name, identified)), found.corrects)
    drive = DOUBLES[name](written(name, identified))
    for axis, letter in enumerate("XYZ"):
        places = along(identified, axis)
        one = told.change(f"positioning E_{letter}{letter}")
        assert one.before == pytest.approx(positioning(cell, places, places, axis), abs=0.03e-6)
        true = positioning(cell, places, drive(places, +1), axis)
        # Between nodes Fanuc's steps leave more than at them; the figure has both.
        assert one.after == pytest.approx(true, abs=1.2e-6 if name == "fanuc" else 0.03e-6)
        assert one.corrected


def test_forward_and_reverse_columns_take_off_lost_motion():
    _, identified = measured(lost_motion=2e-6)
    assert set(identified.reversal) == {0, 1, 2}
    assert np.max(np.abs(identified.reversal[1])) == 0.0
    reversal = identified.reversal[0]
    assert np.abs(reversal) == pytest.approx(np.full(11, 2e-6), abs=0.02e-6)
    drive = DOUBLES["linuxcnc"](written("linuxcnc", identified))
    places = along(identified, 0)
    ahead, back = drive(places, +1), drive(places, -1)
    # The axis is sent farther where it comes short: the difference is the reversal error undone.
    assert (ahead - back)[:, 0] == pytest.approx(-reversal, abs=1e-9)
    # Without a table for it, the reversal error is part of what remains.
    for name, left in (("linuxcnc", 0.0), ("heidenhain", 2e-6)):
        found = control(name)
        told = remainder(identified, found.read(written(name, identified)), found.corrects)
        assert told.change("positioning E_XX").after == pytest.approx(left, abs=0.15e-6)
        assert told.change("positioning E_YY").after < 0.15e-6
        # Half of it either way, in every place of the volume.
        assert told.change("volume, rms").after > 0.45 * left
    siemens = DOUBLES["siemens"](
        written("siemens", identified, reversal="tables", tables=20, digits=7)
    )
    assert (siemens(places, 1) - siemens(places, -1))[:, 0] == pytest.approx(-reversal, abs=1e-9)
    mean = (siemens(places, 1) + siemens(places, -1) - ahead - back)[:, 0]
    # The other axes, which stand at the corner, correct X too.
    assert mean == pytest.approx(np.full(11, mean[0]), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("linuxcnc", {"type": 0}),
        ("linuxcnc", {"units": "inch"}),
        ("linuxcnc", {"spacing": 0.0021}),
        ("siemens", {"first_table": 3, "spacing": 0.007}),
        ("fanuc", {"spacing": 0.004, "detection_unit_um": 0.1, "value_limit": 127}),
        ("fanuc", {"reference": (0.2, -0.1, -0.2)}),
        ("fanuc", {"reference": (-0.3, 0.3, 0.1)}),
        ("heidenhain", {"digits": 6}),
    ],
    ids=str,
)
def test_every_form_of_a_table_does_the_same(name, options):
    _, identified = measured()
    files = written(name, identified, **options)
    if "first_table" in options:
        assert "$AN_CEC[8,0]" in files["NC_CEC.INI"] and "$AN_CEC[2,0]" not in files["NC_CEC.INI"]
        files["NC_CEC.INI"] = files["NC_CEC.INI"].replace("[8", "[2").replace("[7", "[1")
        files["NC_CEC.INI"] = files["NC_CEC.INI"].replace("[6", "[0")
    drive = DOUBLES[name](files)
    axis = 0
    nodes = identified.error_map.nodes[axis]
    places = along(identified, axis)
    curve = identified.error_map.curves["E_XX"]
    reference = np.clip(options.get("reference", (0.0,))[0], nodes[0], nodes[-1])
    expected = np.interp(reference, nodes, curve) - curve
    sent = (drive(places, +1) - places)[:, axis]
    if name in ("siemens", "heidenhain"):
        # The other axes, which stand at the corner, correct X too.
        expected, sent = expected - expected[0], sent - sent[0]
    # A coarse or fine grid of linear pieces of the same curve; Fanuc's steps are as high as they
    # are, up to half an interval of the steepest piece.
    steepest = np.max(np.abs(np.diff(curve) / np.diff(nodes)))
    slack = {"linuxcnc": 0.3e-6, "siemens": 1.2e-6, "heidenhain": 2e-9, "fanuc": 0.0}[name]
    if name == "fanuc":
        slack = 0.5 * steepest * options.get("spacing", 0.002)
        slack += 0.5e-6 * options.get("detection_unit_um", 1.0) + 1e-9
    assert sent == pytest.approx(expected, abs=slack)


def test_corrections_are_zero_at_the_reference_point():
    _, identified = measured()
    reference = (0.07, 0.05, -0.02)
    for name in TABLES:
        files = written(name, identified, reference=reference)
        applied = control(name).read(files)
        there = np.array([reference])
        moved = applied.sent(there, True) - there
        assert np.max(np.abs(moved)) < 0.35e-6, name


def test_the_axes_of_siemens_tables_are_those_of_the_order_in_the_file_whatever_their_names():
    _, identified = measured()
    places = np.vstack([along(identified, axis) for axis in range(3)])
    sent = [
        control("siemens").read(written("siemens", identified, axes=axes)).sent(places, True)
        for axes in ("X1,Y1,Z1", "X1,Y1,W1", "Z1,Y1,X1")
    ]
    assert np.ptp(sent[0] - places) > 1e-6
    assert np.array_equal(sent[1], sent[0]) and np.array_equal(sent[2], sent[0])
    files = written("siemens", identified)
    files["AX_EEC.INI"] = "\n".join(
        line for line in files["AX_EEC.INI"].splitlines() if "X1]" not in line
    )
    with refused(Refusal, "missing", about="AX_EEC.INI"):
        control("siemens").read(files)


def test_tables_on_top_of_tables_contain_them():
    _, identified = measured()
    old = TableSet(
        (
            ControlTable(
                0, 0, np.array([-0.05, 0.15]), np.array([1e-6, -4e-6]), np.array([1e-6, -4e-6])
            ),
        )
    )
    made = replace(layout("linuxcnc"), on_top_of=old)
    files = control("linuxcnc").write(identified, made)
    alone = DOUBLES["linuxcnc"](written("linuxcnc", identified))
    both = DOUBLES["linuxcnc"](files)
    places = along(identified, 0)
    expected = old.sent(places, True) - places
    assert both(places, 1) - alone(places, 1) == pytest.approx(expected, abs=1e-9)
    # Seen by errors that were measured with the old ones at work, the new ones do the same as ever.
    fresh = remainder(identified, control("linuxcnc").read(written("linuxcnc", identified)), ())
    seen = remainder(identified, Beyond(control("linuxcnc").read(files), old), ())
    for one, other in zip(fresh.changes, seen.changes, strict=True):
        assert other.after == pytest.approx(one.after, abs=2e-9)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("linuxcnc", {"spacing": 0.0005}, a_fault("too_many", "401", "256")),
        ("siemens", {"tables": 3}, a_fault("too_many", "6", "3")),
        ("siemens", {"points": 5}, a_fault("too_many", "11", "5")),
        ("siemens", {"axes": "X1,Y1"}, a_fault("malformed", aspect="axes")),
        ("heidenhain", {"spacing": 0.0003}, a_fault("too_many", "256")),
        ("fanuc", {"spacing": 0.001}, a_fault("too_many", "128")),
        (
            "fanuc",
            {"spacing": 0.05, "magnification": 1, "detection_unit_um": 0.01},
            a_fault("out_of_range", "7", aspect="change"),
        ),
        ("linuxcnc", {"joints": "0,a,2"}, a_fault("malformed", aspect="joints")),
    ],
    ids=str,
)
def test_what_is_beyond_the_limits_of_a_control_is_refused(name, options, words):
    _, identified = measured()
    with refused(Refusal, words):
        written(name, identified, **options)


def larger(identified: Identified, factor: float) -> Identified:
    curves = {name: factor * curve for name, curve in identified.error_map.curves.items()}
    return replace(identified, error_map=replace(identified.error_map, curves=curves))


@pytest.mark.parametrize("name", TABLES)
def test_errors_that_no_table_should_correct_are_refused(name):
    _, identified = measured()
    options = {"spacing": 0.002} if name == "fanuc" else {}
    with refused(Refusal, "out_of_range", aspect="limit"):
        written(name, larger(identified, 500.0), **options)


@pytest.mark.parametrize("name", TABLES)
def test_a_curve_that_is_not_determined_is_refused_by_name(name):
    _, identified = measured()
    curves = {**identified.error_map.curves, "E_YY": np.full(11, np.nan)}
    holed = replace(identified, error_map=replace(identified.error_map, curves=curves))
    with refused(Refusal, "undetermined", "E_YY"):
        written(name, holed)


@pytest.mark.parametrize(
    ("name", "file", "change", "words"),
    [
        (
            "linuxcnc",
            "x.comp",
            lambda t: "# header\n" + t,
            a_fault("malformed", "x.comp", "1", aspect="line"),
        ),
        ("linuxcnc", "y.comp", lambda t: t + t, a_fault("out_of_order", "y.comp", "12")),
        (
            "siemens",
            "AX_EEC.INI",
            lambda t: t.replace("]=", "]:="),
            a_fault("malformed", "AX_EEC.INI", aspect="line"),
        ),
        (
            "siemens",
            "NC_CEC.INI",
            lambda t: t.replace("$AN_CEC[0,3]", ";"),
            a_fault("mismatch", "$AN_CEC[0]"),
        ),
        ("heidenhain", "X.COM", lambda t: t.replace("[END]", ""), a_fault("malformed", "BEGIN")),
        (
            "heidenhain",
            "X.COM",
            lambda t: t.replace("AXISPOS", "POSITION"),
            a_fault("missing", "AXISPOS"),
        ),
        (
            "fanuc",
            "PITCH.TXT",
            lambda t: t.replace("P", "R"),
            a_fault("malformed", "2", aspect="line"),
        ),
        (
            "fanuc",
            "parameters_3620.txt",
            lambda t: t.replace("3621 Y", "3629 Y"),
            a_fault("missing", "3621"),
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "changed",
)
def test_a_damaged_table_is_refused_by_file_and_line(name, file, change, words):
    _, identified = measured()
    files = written(name, identified)
    with refused(Refusal, words):
        control(name).read({**files, file: change(files[file])})


def runs(forward, backward):
    targets = np.arange(forward.shape[1]) * 0.01
    return BidirectionalRuns("X", "linear", targets, forward, backward)


def test_a_reversal_error_is_taken_only_as_far_as_it_stands_out_from_noise():
    rng = np.random.default_rng(4)
    noise = 0.1e-6 * rng.standard_normal((2, 3, 13))
    found, words = reversal_of(runs(noise[0], noise[1]))
    assert np.all(found == 0.0) and "zero within the noise" in words
    found, words = reversal_of(runs(noise[0] + 0.5e-6, noise[1]))
    assert np.ptp(found) == 0.0 and found[0] == pytest.approx(0.5e-6, abs=0.06e-6)
    assert "the same everywhere" in words
    found, words = reversal_of(runs(noise[0] + np.linspace(0, 2e-6, 13), noise[1]))
    assert np.ptp(found) > 1.5e-6 and "place to place" in words
    found, words = reversal_of(runs(noise[0, :1], noise[1, :1]))
    assert np.ptp(found) > 0.0 and "not known" in words
    found, words = reversal_of(runs(noise[0, :1], noise[1, :1]), 0.1e-6)
    assert np.all(found == 0.0)
