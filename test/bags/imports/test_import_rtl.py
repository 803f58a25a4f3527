"""Renishaw .rtl files: what is read from them, and what is refused with its row."""

import math

import numpy as np
import pytest
from import_files import DATA, RTL, changed
from refused import a_fault, refused

from stepdiag_ros.bags.attachments import write_attachments
from stepdiag_ros.bags.errors import BagError, BagWriteError, TableError
from stepdiag_ros.bags.header import Attachment, RunHeader
from stepdiag_ros.bags.imports.imported import ImportOptions
from stepdiag_ros.bags.imports.registry import import_file, read_file
from stepdiag_ros.bags.reader import BagReader
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.bags.writer import BagWriter, UnbufferedFile
from stepdiag_ros.commands.iso230 import report_of
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD
from stepdiag_ros.metrology.standards.axis_test import all_runs


def deviations():
    """Read the rows of the example by hand: (run, target number) → µm."""
    text = RTL.read_bytes().decode("cp1252").split("Run Target Data:")[1].split("ENVIRONMENT")[0]
    rows = [line.split() for line in text.splitlines() if line.strip()]
    return {(int(run), int(target)): float(value) for run, target, value in rows}


TARGETS = (0.0, -50.0, -100.0, -150.5, -200.0, -250.0, -300.0, -349.5, -400.0)


def test_every_deviation_arrives_at_its_target_and_in_its_direction():
    _, made = read_file(RTL)
    expected = deviations()
    assert len(expected) == 54 and made.stops == 54
    for number, line in enumerate(made.lines, start=1):
        # The file's first run goes towards smaller coordinates: that is backward.
        assert line.line.direction == (BACKWARD if number % 2 else FORWARD)
        assert line.line.repeat == (number - 1) // 2
        order = range(9) if number % 2 else range(8, -1, -1)
        for stop, place in enumerate(order):
            assert line.target[stop] == pytest.approx([1e-3 * TARGETS[place], 0.0, 0.0], abs=1e-15)
            reading = 1e-3 * TARGETS[place] + 1e-6 * expected[number, place + 1]
            assert line.displacement[stop] == pytest.approx(reading, abs=1e-15)
        assert np.all(np.isnan(line.time)) and np.all(np.isnan(line.standard_uncertainty))


def test_what_the_file_tells_is_kept_and_what_it_does_not_tell_is_unknown():
    _, made = read_file(RTL)
    air, pressure, humidity, material = made.lines[0].environment[0]
    assert (air, pressure, humidity, material) == pytest.approx((20.38, 98710.0, 0.453, 21.3))
    assert made.facts["machine"] == "Fräszentrum Muster 400"
    assert made.facts["machine_serial_number"] == "0815-47"
    assert float(made.facts["expansion_coefficient_per_K"]) == pytest.approx(11.7e-6)
    assert made.facts["compensation_state"].startswith("unknown")
    assert "location" in made.facts and "instrument" not in made.facts
    said = " ".join(made.remarks)
    assert "Windows-1252" in said and "not evenly spaced" in said and "Y and Z stood" in said


def test_a_unit_that_is_not_known_is_unknown_and_not_guessed(tmp_path):
    path = changed(RTL, "98.700000 98.720000 1", "740.3 740.5 2", tmp_path)
    _, made = read_file(path)
    assert math.isnan(made.lines[0].environment[0, 1])
    assert any("Air press" in remark and "not known" in remark for remark in made.remarks)
    assert made.facts["environment: Air press"] == "740.3 740.5 2"


def test_the_bag_gives_the_file_back_and_the_standard_evaluates_it(tmp_path):
    bag = tmp_path / "axis.mcap"
    import_file(RTL, bag, ImportOptions(standing=(0.0, 0.25, 0.125)))
    files = write_attachments(bag, tmp_path / "out")
    assert tmp_path / "out" / "source" / RTL.name in files
    assert (tmp_path / "out" / "source" / RTL.name).read_bytes() == RTL.read_bytes()
    with BagReader(bag) as opened:
        facts = opened.header.facts
    assert facts["source_file"] == RTL.name and len(facts["source_sha256"]) == 64
    assert facts["source: operator"] == "A. Beispiel"
    run = load_run(bag)
    assert run.lines[0].target[0].tolist() == [0.0, 0.25, 0.125]
    (runs,) = all_runs(run.measurement)
    assert runs.target == pytest.approx(1e-3 * np.array(TARGETS[::-1]))
    expected = deviations()
    mean = np.mean([[expected[run, k] for k in range(9, 0, -1)] for run in (2, 4, 6)], axis=0)
    (test,) = report_of(bag).tests
    got = test.mean_forward - test.mean_forward[-1]
    assert got == pytest.approx(1e-6 * (mean - mean[-1]), abs=1e-15)
    assert test.name == "X" and test.runs == (3, 3)


def test_the_same_file_has_the_same_identity_and_a_bag_is_never_overwritten(tmp_path):
    for name in ("a", "b"):
        import_file(RTL, tmp_path / f"{name}.mcap", ImportOptions())
    assert load_run(tmp_path / "a.mcap").run_id == load_run(tmp_path / "b.mcap").run_id
    with refused(BagError, "exists", "a.mcap"):
        import_file(RTL, tmp_path / "a.mcap", ImportOptions())


@pytest.mark.parametrize("place", [(BagWriter, "write"), (UnbufferedFile, "sync")])
def test_a_bag_that_cannot_be_written_leaves_nothing(tmp_path, monkeypatch, place):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(*place, full)
    with refused(BagWriteError, "unwritable", where=str(tmp_path / "a.mcap")) as caught:
        import_file(RTL, tmp_path / "a.mcap", ImportOptions())
    assert "partial" not in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "name", ["../out.txt", "/tmp/out.txt", "a/../../out.txt", "..\\out.txt", ""]
)
def test_an_attachment_s_name_cannot_lead_out_of_the_folder(name, tmp_path):
    header = RunHeader("run", "plan", "0", 1, "none", 0, further=(Attachment(name, "x/y", b"1"),))
    with BagWriter(tmp_path / "evil.mcap", header):
        pass
    with refused(BagError, "malformed", "evil.mcap"):
        write_attachments(tmp_path / "evil.mcap", tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["evil.mcap"]


def test_the_name_of_the_file_does_not_matter(tmp_path):
    copy = tmp_path / "whatever.rtl2"
    copy.write_bytes(RTL.read_bytes())
    assert read_file(copy)[1].stops == 54
    wide = tmp_path / "wide.txt"
    wide.write_bytes(RTL.read_bytes().decode("cp1252").encode("utf-16"))
    _, made = read_file(wide)
    assert made.stops == 54 and made.facts["machine"] == "Fräszentrum Muster 400"
    assert not any("Windows" in remark for remark in made.remarks)


def test_decimal_commas_are_read_when_said(tmp_path):
    text = RTL.read_bytes().decode("cp1252").replace(".", ",")
    copy = tmp_path / "comma.rtl"
    copy.write_text(text, encoding="utf-8")
    assert read_file(copy, ImportOptions(decimal=","))[1].stops == 54
    with refused(TableError, "malformed", "0,000000", row=10):
        read_file(copy)
    with refused(TableError, "malformed", "--decimal"):
        read_file(RTL, ImportOptions(decimal=","))


def test_directions_that_the_rows_do_not_tell_are_asked_for(tmp_path):
    head, rest = RTL.read_bytes().decode("cp1252").split("Run Target Data:")
    rows, tail = rest.split("ENVIRONMENT::")
    sorted_rows = sorted(
        (line for line in rows.splitlines() if line.strip()),
        key=lambda line: [int(word) for word in line.split()[:2]],
    )
    copy = tmp_path / "sorted.rtl"
    copy.write_text(
        f"{head}Run Target Data:\n" + "\n".join(sorted_rows) + f"\n\nENVIRONMENT::{tail}"
    )
    with refused(TableError, "ambiguous", "6", "--directions"):
        read_file(copy)
    alternating = read_file(copy, ImportOptions(directions="alternating"))[1]
    for line, original in zip(alternating.lines, read_file(RTL)[1].lines, strict=True):
        assert line.line == original.line
        assert line.displacement == pytest.approx(original.displacement, abs=1e-15)
    same = read_file(copy, ImportOptions(directions="same"))[1]
    assert {line.line.direction for line in same.lines} == {BACKWARD}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("1    5    2.664", "1    5    2664.0", a_fault("mismatch", "2664", row=32)),
        ("1    5    2.664", "1    5", a_fault("malformed", "1    5", row=32)),
        ("1    5    2.664", "1    5    nan", a_fault("malformed", "nan", row=32)),
        ("1    5    2.664", "1    50    2.664", a_fault("out_of_range", "50", "9", row=32)),
        ("1    5    2.664", "1    4    2.664", a_fault("twice", "-150.5", "1", row=32)),
        ("1    4    0.574", "1    2    0.574", a_fault("twice", "-50", row=31)),
        ("1    5    2.664\r\n", "", a_fault("missing", "1", "-200")),
        ("Target-count: 9", "Target-count: 10", a_fault("mismatch", "10", "9", row=8)),
        ("Run-count:6", "Run-count:10", a_fault("mismatch", "24", "10", "6")),
        ("Axis: X", "Axis: diagonal", a_fault("unknown", "diagonal", "--axis", aspect="axis")),
        ("Axis: X", "", a_fault("unknown", "made_up_axis.rtl", aspect="axis")),
        ("RUNS::", "HEADER::", a_fault("twice", "HEADER", row=23)),
        ("EOF::", "EOF::\r\nmore", a_fault("too_many", "EOF")),
        ("Targets :", "Aims :", a_fault("malformed", "0.000000", "TARGET", "DATA", row=10)),
        ("-400.000000", "-400000.0", a_fault("out_of_range", "-400000")),
    ],
)
def test_what_contradicts_itself_is_refused_with_its_row(old, new, said, tmp_path):
    path = changed(RTL, old, new, tmp_path)
    with refused(TableError, said) as caught:
        read_file(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_rows_out_of_order_are_refused(tmp_path):
    path = changed(RTL, "1    5    2.664\r\n1    6    3.944", "1 6 3.944\r\n1 5 2.664", tmp_path)
    with refused(TableError, "out_of_order", "1", "-250", row=33):
        read_file(path)


def test_a_file_cut_anywhere_in_its_measurement_is_refused(tmp_path):
    data = RTL.read_bytes()
    end = data.index(b"\r\n\r\nENVIRONMENT")
    copy = tmp_path / "cut.rtl"
    # Behind the last row only the environment is missing, and a digit less is not to be seen.
    for length in range(30, end - 2, 17):
        copy.write_bytes(data[:length])
        with pytest.raises(TableError):
            read_file(copy)
    copy.write_bytes(data[:end])
    assert "EOF" in " ".join(read_file(copy)[1].remarks)


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("angles.rta", RTL.read_bytes(), a_fault("wrong_kind", "angles.rta", aspect="quantity")),
        ("new.rtl2", b"PK\x03\x04rest", a_fault("wrong_kind", aspect="layout")),
        ("new.rtl2", b"<?xml version='1.0'?><a/>", a_fault("unknown", aspect="format")),
        ("empty.rtl", b"  \r\n", a_fault("too_few", "empty.rtl")),
        ("binary.rtl", b"HEADER::\r\n\x00\x01", a_fault("wrong_kind", row=2, aspect="text")),
    ],
)
def test_what_is_no_such_file_is_refused(name, data, said, tmp_path):
    (tmp_path / name).write_bytes(data)
    with refused(TableError, said):
        read_file(tmp_path / name)


def test_a_file_that_is_not_there_and_a_folder(tmp_path):
    with refused(TableError, "not_found", "none.rtl"):
        read_file(tmp_path / "none.rtl")
    with refused(TableError, "unreadable"):
        read_file(DATA)
