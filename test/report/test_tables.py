"""What is printed."""

import io

import pytest
from results_by_hand import VOLUME, make_report, make_result, with_rotations, with_unknown

from stepdiag_ros.metrology.plan import Line, Plan
from stepdiag_ros.metrology.visibility import visibility
from stepdiag_ros.report.tables.run import print_report, visibility_sentences
from stepdiag_ros.text.console import make_console


def printed(report, **options):
    stream = io.StringIO()
    print_report(report, make_console(stream), **options)
    return stream.getvalue()


def row(text, *words):
    lines = [line for line in text.splitlines() if all(word in line for word in words)]
    assert len(lines) == 1, (words, lines)
    return lines[0]


def test_what_a_reader_must_know_is_said():
    text = printed(make_report(refused={"guess": "too little"}))
    for words in (
        "20260102T030405-abcd",
        "chain YXZ",
        "mean slopes of E_YX, E_ZX and E_YZ",
        "right-handed rotation",
        "1.96 standard uncertainties (95 %)",
        "noise taken from the readings",
        "guess: not solved, too little",
    ):
        assert words in text
    assert "1.05" in row(text, "χ² / degrees of freedom")


def test_squareness_in_both_units_and_both_sign_definitions():
    rotation = printed(make_report())
    same = ["12.35", "±", "0.49"]
    assert row(rotation, "B0Z  Z to X").split()[4:] == ["µm/m", *same, *same, *same, "unknown"]
    assert row(rotation, "C0Y  Y to X").split()[-1] == "12.00"
    assert "2.55 ± 0.10" in rotation
    angle = printed(make_report(), definition="angle")
    assert row(angle, "B0Z  Z").split()[5] == "-12.35"
    assert row(angle, "A0Z  Z").split()[5] == "12.35"
    assert "larger than 90°" in angle


def test_unknown_is_printed_as_unknown():
    text = printed(make_report(results=(with_unknown(make_result()),)))
    assert row(text, "E_YZ  of Z in Y").split()[-2] == "unknown"
    assert "E_YZ: no line tells it" in text
    assert "0.40 ± unknown" in row(text, "E_YX  of X in Y")


def test_comparison_with_truth_only_where_truth_is_known():
    assert "27 of 27" in row(printed(make_report()), "true value inside")
    assert "true value" not in printed(make_report(truth=None)).lower()


def test_difference_from_the_recorded_result_cannot_be_overlooked():
    equal = {"least_squares": False, "setup_robust": True}
    for rounded, answer in ((frozenset(), "NO, DIFFERS"), ({"least_squares"}, "to rounding")):
        text = printed(make_report(equals_recorded=equal, rounded=rounded))
        said = " ".join(row(text, "same bits as recorded").split()[4:])
        assert said == f"none recorded yes {answer}"


@pytest.mark.parametrize("width", ["40", "200"])
def test_no_number_is_cut_however_narrow_the_terminal(width, monkeypatch):
    monkeypatch.setenv("COLUMNS", width)
    text = printed(make_report())
    assert "…" not in text
    assert "20.000 0.087 ± 0.098 0.153 ± 0.098 0.220 ± 0.098" in " ".join(text.split())


def test_names_with_brackets_are_printed_as_they_are():
    assert "lines[3] :x:" in printed(make_report(plan="lines[3] :x:"))


def test_rotations_are_printed_in_microradians_where_they_are_determined():
    text = printed(make_report(results=(with_rotations(make_result()), make_result())))
    assert "Rotations as Y moves, Rigid body (all 21 errors)" in text
    assert "E_AY / µrad" in text
    assert "E_BY / µrad" not in text
    assert row(text, "E_AX  of X about X").split()[5:9] == ["µrad", "15.0", "±", "2.0"]
    assert "Rotations as" not in printed(make_report())


def test_visibility_is_printed_as_verdicts_with_expanded_uncertainties():
    lines = tuple(Line("linear", name, "", 0, "forward") for name in "xy")
    table = visibility(Plan("two", VOLUME, lines, 0.05), "YXZ", 1e-7)
    text = printed(make_report(visibility=table))
    assert row(text, "E_YY", "determined").split() == [
        *("E_YY", "determined", "µm", "0.28", "0.28", "1.4")
    ]
    assert row(text, "E_BZ", "invisible").split()[-3:] == ["-", "-", "-"]
    assert "no line sees it" in row(text, "E_ZZ", "invisible")
    assert "Visibility for the chain YXZ" in text
    assert "0.1 µm (standard uncertainty) a stop" in text
    assert "Visibility" not in printed(make_report())


def test_visibility_names_the_methods_that_give_what_it_calls_confounded():
    lines = (
        Line("linear", "x", "", 0, "forward"),
        Line("step_diagonal", "ppp", "XYZ", 0, "forward"),
    )
    table = visibility(Plan("two", VOLUME, lines, 0.05), "YXZ", 1e-7)
    assert table.row("E_YX").status != "determined" and table.row("E_XX").status == "determined"
    results = [make_result("least_squares"), with_rotations(make_result("rigid_body"))]
    (said,) = [text for text in visibility_sentences(table, results) if "as zero" in text]
    assert "Least squares: E_YX" in said and "C0Y" in said
    assert "E_XX" not in said and "E_AX" not in said, "told, or by no such method"
    assert "Rigid body" not in said and "conventional" not in said
    unknown = with_unknown(make_result("least_squares"))
    (said,) = [text for text in visibility_sentences(table, [unknown]) if "as zero" in text]
    assert "E_YZ" not in said
    assert "setup as perfect" in visibility_sentences(table, [make_result("conventional")])[-1]
    assert not [text for text in visibility_sentences(table, results[1:]) if "as zero" in text]
