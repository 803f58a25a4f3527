"""Pictures and pages of tests by standards: what stands on them, and that they can be printed."""

from dataclasses import replace

import numpy as np
import pytest
from refused import refused

from stepdiag_ros import plots
from stepdiag_ros.evaluation.positioning import PositioningReport, Published, same_test
from stepdiag_ros.metrology.plan import DIAGONAL, LINEAR
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.standards.axis_test import BidirectionalRuns
from stepdiag_ros.metrology.standards.diagonal_squareness import squareness_error_of_shift
from stepdiag_ros.metrology.standards.iso230_2 import evaluate
from stepdiag_ros.plots.files.positioning import draw_positioning
from stepdiag_ros.plots.files.volumetric import examples_picture
from stepdiag_ros.report.tables.positioning import group_tables, parameter_table
from stepdiag_ros.text.numbers import ARC_SECONDS
from stepdiag_ros.words.positioning import decimals_of, written


def one_test(name, kind, slope, reversal=1e-6, runs=5):
    target = np.linspace(0, 0.5, 6)
    rng = np.random.default_rng(1)
    forward = slope * target + 1e-7 * rng.standard_normal((runs, 6))
    return evaluate(BidirectionalRuns(name, kind, target, forward, forward - reversal, setup=name))


@pytest.fixture
def report():
    diagonals = [
        one_test(name, DIAGONAL, slope)
        for name, slope in zip(
            ("ppp", "npp", "pnp", "ppn"), (15e-6, 12e-6, 9e-6, 7e-6), strict=True
        )
    ]
    return PositioningReport((*diagonals, one_test("X", LINEAR, 4e-6)), "a source")


def texts_of(picture):
    from matplotlib.table import Cell
    from matplotlib.text import Text

    # A cell's text is no child of it.
    texts = [*picture.findobj(Text), *(cell.get_text() for cell in picture.findobj(Cell))]
    return [text.get_text() for text in texts if text.get_text()]


def test_the_page_of_the_diagonals_holds_all_that_the_standard_asks_for(report, tmp_path):
    pictures = draw_positioning(report)
    assert set(pictures) == {"iso230_2_X", "iso230_6_body_diagonals"}
    page = pictures["iso230_6_body_diagonals"]
    said = "\n".join(texts_of(page))
    (group,) = report.groups
    decimals = decimals_of(group.tests)
    for label, test in zip(group.labels, group.tests, strict=True):
        assert f"{label}: {test.name}" in said
        assert f"{test.name} ({label})" in said
        assert written(test.parameters["E"], np.nan, decimals) in said
        assert written(test.parameters["B"], np.nan, decimals) in said
    assert "Sys dev (E_d)" in said
    assert "Reversal (B_d)" in said
    assert "Missing here: linear positioning of Y, Z" in said.replace("\n", " ")
    plots.save(page, tmp_path / "page.pdf")
    assert (tmp_path / "page.pdf").read_bytes().startswith(b"%PDF")


def test_the_graphs_show_the_mean_deviations(report):
    page = draw_positioning(report)["iso230_6_body_diagonals"]
    panels = [axes for axes in page.findobj() if hasattr(axes, "get_lines") and axes.get_lines()]
    lines = {line.get_label(): line for line in panels[0].get_lines()}
    test = report.tests[0]
    forward = next(line for label, line in lines.items() if "forward" in str(label))
    expected = (test.mean_forward - test.mean_forward[0]) * 1e6
    np.testing.assert_allclose(forward.get_ydata(), expected)
    backward = next(line for label, line in lines.items() if "backward" in str(label))
    np.testing.assert_allclose(
        backward.get_ydata(), (test.mean_backward - test.mean_forward[0]) * 1e6
    )


def test_the_sensitivity_graph_is_that_of_the_formula():
    (axes,) = plots.squareness_sensitivity().axes
    ends = sorted(
        float(line.get_ydata()[-1]) for line in axes.get_lines() if len(line.get_xdata()) > 2
    )
    one, five = (float(squareness_error_of_shift(s, 10.0)) * ARC_SECONDS for s in (1e-6, 5e-6))
    assert ends == pytest.approx([-five, -one, one, five])


def test_the_examples_picture_has_the_figures_of_the_document():
    said = texts_of(examples_picture())
    for figure in ("0", "29", "14", "122", "50", "115"):
        assert figure in said


def test_numbers_are_written_to_their_uncertainty():
    assert written(6.8815e-8, np.nan, 5) == "0.06882 ± unknown"
    assert written(7.73e-6, 0.42e-6, 3) == "7.73 ± 0.42"
    assert written(np.nan, 1e-6, 3) == "unknown"


def test_an_uncertainty_that_no_row_knows_is_said_unknown_once(report):
    test = report.tests[-1]
    table = parameter_table(test, None, 3)
    assert table.columns[2].header == "value / µm, U unknown"
    assert table.rows and not any("±" in row[2] for row in table.rows)
    known = replace(test, expanded_uncertainty={**test.expanded_uncertainty, "E": 1e-7})
    table = parameter_table(known, None, 3)
    cells = {row[0]: row[2] for row in table.rows}
    assert table.columns[2].header == "value ± U / µm"
    assert cells["E"].endswith("± 0.10") and cells["A"].endswith("± unknown")
    small = " ".join(texts_of(plots.iso230_2(test)))
    assert "µm, U unknown:" in small and "±" not in small.split("U unknown:")[1]
    assert "µm, U for k = 2:" in " ".join(texts_of(plots.iso230_2(known)))
    (group,) = report.groups
    result, each = group_tables(group, 3)
    assert result.columns[1].header == "value / µm, U unknown"
    shown = [row[1] for row in result.rows] + [row[2] for row in each.rows]
    assert shown and not any("±" in cell for cell in shown)


@pytest.mark.parametrize(
    ("printed", "value", "agrees"),
    [
        (3.68, 3.6849, True),  # rounded
        (3.68, 3.6751, True),
        (3.68, 3.6899, True),  # truncated
        (3.68, 3.6749, False),
        (3.68, 3.6902, False),
        (-3.68, -3.6899, True),
        (-3.68, -3.6902, False),
        (-3.68, -3.6749, False),
        (0.0, -0.09, True),
        (0.0, 0.11, False),
    ],
)
def test_a_published_figure_agrees_to_its_last_printed_digit(printed, value, agrees):
    published = Published.from_numbers("theirs", {"M": printed}, 1e-6)
    assert published.agrees("M", 1e-6 * value) == agrees


def test_a_published_figure_of_another_name_is_refused():
    with refused(Refusal, "unknown", "Z"):
        Published.from_numbers("theirs", {"Z": 1.0}, 1e-3)


def test_one_bit_makes_a_test_another(report):
    test = report.tests[0]
    assert same_test(test, replace(test))
    parameters = {**test.parameters, "E": np.nextafter(test.parameters["E"], 1.0)}
    assert not same_test(test, replace(test, parameters=parameters))
