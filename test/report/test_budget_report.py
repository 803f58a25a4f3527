"""Tables, JSON and pictures of a budget."""

import io
import json
from dataclasses import replace

import pytest

from stepdiag_ros.configuration import load_cell, load_instrument, load_plan
from stepdiag_ros.evaluation.budget import BudgetReport
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.uncertainty.budget import make_budget
from stepdiag_ros.metrology.uncertainty.instrument import Spread
from stepdiag_ros.metrology.uncertainty.monte_carlo import check_budget
from stepdiag_ros.metrology.uncertainty.source import ANGULAR, GROUPS, REPEATABILITY
from stepdiag_ros.plots.files.budget import draw_budget
from stepdiag_ros.report.documents.budget import budget_document, budget_json
from stepdiag_ros.report.tables.budget import print_budget
from stepdiag_ros.text.console import make_console
from stepdiag_ros.text.numbers import with_uncertainty
from stepdiag_ros.words.budget import LOWERED_BY


@pytest.fixture(scope="module")
def report():
    measurement = simulate(load_plan("quick")[0], load_cell("demo")[0], seed=1)
    known = load_instrument("demo")[0]
    known = replace(known, air_pressure=Spread())
    budget = make_budget(measurement, known, expansion=11.5e-6)
    return BudgetReport(budget, check_budget(budget, most_trials=50_000), "run 1")


def printed(report):
    stream = io.StringIO()
    print_budget(report, make_console(stream))
    return stream.getvalue()


def row_of(text, title, name):
    lines = text[text.index(title) :].splitlines()
    return next(line for line in lines if line.strip().startswith(name)).split()


def test_tables_say_what_is_known_and_what_it_makes(report):
    text = printed(report)
    assert row_of(text, "What is known", "air temperature")[2:4] == ["0.1", "K"]
    assert row_of(text, "What is known", "resolution of the counter")[4:6] == ["0.000289", "µm"]
    assert "unknown" in row_of(text, "What is known", "air pressure")
    expansion = row_of(text, "What is known", "expansion coefficient")
    assert expansion[2:6] == ["0.577", "µm/(m", "K)", "B"]
    table = "Positioning error at the end of the travel: standard uncertainty by source, µm"
    budget = report.budget
    place = budget.row("positioning E_XX")
    temperature = [source.name for source in budget.sources].index("air temperature")
    assert row_of(text, table, "air temperature")[2] == (
        f"{budget.contributions[temperature, place] * 1e6:.4f}"
    )
    # What is not known is listed once, and U has two significant digits.
    assert "air pressure" not in text[text.index(table) :].partition("result")[0]
    assert text.count("air pressure ") == 1 and "--instrument" in text
    assert (
        row_of(text, table, "expanded U")[4] == with_uncertainty(0, budget.expanded[place] * 1e6)[1]
    )
    assert row_of(text, table, "combined u")[2:4] == [
        "≥",
        f"{budget.standard_uncertainty[place] * 1e6:.4f}",
    ]
    value, expanded = budget.sensitivity.values[place] * 1e6, budget.expanded[place] * 1e6
    assert row_of(text, table, "result")[1] == with_uncertainty(value, expanded)[0]
    assert "lower bounds: air pressure" in text
    assert "Squareness sign: right-handed rotation" in text
    assert "run 1" in text


def test_the_largest_source_is_named_with_what_lowers_it(report):
    assert set(LOWERED_BY) == set(GROUPS)
    budget = report.budget
    assert budget.largest_group == REPEATABILITY
    turning = [[1e3 if one.group == ANGULAR else 1.0] for one in budget.sources]
    assert replace(budget, contributions=budget.contributions * turning).largest_group == ANGULAR


def test_monte_carlo_is_printed_with_its_verdict(report):
    text = printed(report)
    assert row_of(text, "Monte Carlo,", "C0Y")[-1] == "pass"
    assert "validated (d_low, d_high ≤ δ; JCGM 101, 8.1)" in text
    without = printed(replace(report, check=None))
    assert "Monte Carlo" not in without


def test_json_is_si_and_knows_unknown(report):
    document = json.loads(budget_json(report))
    assert document == budget_document(report)
    sources = {entry["name"]: entry for entry in document["sources"]}
    assert sources["air pressure"]["standard_uncertainty"] is None
    assert sources["air temperature"]["standard_uncertainty"] == 0.1
    quantities = {entry["name"]: entry for entry in document["quantities"]}
    one = quantities["positioning E_XX"]
    assert one["contributions"]["air pressure"] is None
    assert one["lower_bound_only"] is True
    squares = sum(value**2 for value in one["contributions"].values() if value is not None)
    assert squares == pytest.approx(one["standard_uncertainty"] ** 2, rel=1e-6, abs=0.0)
    assert one["expanded_uncertainty"] == pytest.approx(
        one["coverage_factor"] * one["standard_uncertainty"], rel=1e-9, abs=0.0
    )
    low, high = one["monte_carlo"]["interval"]
    assert low < one["value"] < high
    place = document["quantities"].index(one)
    assert document["covariance"][place][place] == pytest.approx(
        one["standard_uncertainty"] ** 2, rel=1e-9, abs=0.0
    )
    assert {"E_XX at 1", "E_YZ at 1", "C0Y"} <= set(quantities)
    assert document["monte_carlo"]["trials"] == 50_000


def test_pictures_show_every_figure_and_every_curve(report, tmp_path):
    pictures = draw_budget(report)
    bars, curves = pictures["budget"], pictures["budget_curves"]
    labels = [text.get_text() for axes in bars.axes for text in axes.get_yticklabels()]
    assert labels[:3] == ["C0Y", "B0Z", "A0Z"]
    assert len(labels) == 3 + 3 + 3 + 6
    titles = [axes.get_title() for axes in curves.axes]
    assert sum(title.startswith("E_") for title in titles) == 9
    # A bar of a known length: all its pieces together are the combined standard uncertainty.
    squareness = bars.axes[0]
    total = sum(container[0].get_width() for container in squareness.containers)
    place = report.budget.row("C0Y")
    assert total == pytest.approx(report.budget.standard_uncertainty[place] * 1e6, rel=1e-6)
    last = squareness.containers[-1][0]
    assert last.get_x() + last.get_width() == pytest.approx(total, rel=1e-6)
    assert squareness.texts[0].get_text().strip().startswith("≥")
    bars.savefig(tmp_path / "budget.png")
    assert (tmp_path / "budget.png").stat().st_size > 10_000
