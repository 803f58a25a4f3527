"""Figures of a diagnosis, of two runs beside each other, of what lines tell and tables leave."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from metrology.hidden_runs import hidden_run
from refused import refused
from results_by_hand import make_result

from stepdiag_ros import plots
from stepdiag_ros.compensation.remaining import AxisRemainder, BeforeAndAfter, Remainder
from stepdiag_ros.configuration import load_cell, load_plan
from stepdiag_ros.evaluation.diagnosing import Reference, diagnose_reproducibly, summary_of
from stepdiag_ros.metrology.agreement import ComparedMeasurement, compare
from stepdiag_ros.metrology.discrepancy.diagnose import diagnose
from stepdiag_ros.metrology.discrepancy.findings import NAMED
from stepdiag_ros.metrology.effects.effect import Change
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate
from stepdiag_ros.metrology.visibility import visibility
from stepdiag_ros.plots.style import legend_entries

MODEL = "name: free\n"


@pytest.fixture(scope="module")
def diagnosed():
    """A run with hidden backlash of X: its diagnosis, and what is recorded of it."""
    plan = load_plan("quick")[0]
    plan = replace(plan, lines=tuple(_both_ways_twice(plan)))
    measurement = simulate(plan, load_cell("hidden_backlash")[0], seed=1)
    reference = Reference.from_text(MODEL, "model", 0)
    found = diagnose_reproducibly(measurement, reference)
    return found, summary_of(found, measurement, reference, plan)


def _both_ways_twice(plan):
    for line in plan.lines:
        for repeat in (0, 1):
            for direction in ("forward", "backward"):
                yield replace(line, repeat=repeat, direction=direction)


def heights(axes):
    return [patch.get_height() for patch in axes.patches]


def test_the_map_has_every_stop_before_and_after_in_one_scale(diagnosed):
    diagnosis, _ = diagnosed
    assert diagnosis.verdict == NAMED
    before, after, scale = plots.gap_map(diagnosis).axes
    assert before.collections[0].get_clim() == after.collections[0].get_clim()
    stops = diagnosis.stops
    for axes, gap in ((before, diagnosis.residual_before), (after, diagnosis.residual_after)):
        shown = np.ma.filled(axes.collections[0].get_array(), np.nan)
        shown = np.reshape(shown, (len(stops.lines), -1))
        np.testing.assert_allclose(shown[stops.pass_index, stops.number], gap * 1e6, equal_nan=True)
    assert scale.get_ylabel() == "reading minus model / µm"


def test_the_traces_are_the_gap_along_each_pass(diagnosed):
    diagnosis, _ = diagnosed
    figure = plots.gap_along_lines(diagnosis)
    assert [axes.get_title() for axes in figure.axes] == ["x", "y", "z", "ppp", "npp", "pnp"]
    before, after = figure.axes[0].collections
    own = [n for n, line in enumerate(diagnosis.stops.lines) if line.name == "x"]
    for drawn, gap in ((before, diagnosis.residual_before), (after, diagnosis.residual_after)):
        for curve, index in zip(drawn.get_segments(), own, strict=True):
            rows = diagnosis.stops.pass_index == index
            np.testing.assert_allclose(curve[:, 1], gap[rows] * 1e6)


def test_a_recorded_diagnosis_gives_the_same_figures(diagnosed):
    for function in (plots.gap_where, plots.gap_candidates, plots.gap_figures):
        one, other = (function(source) for source in diagnosed)
        for mine, theirs in zip(one.axes, other.axes, strict=True):
            assert mine.get_title() == theirs.get_title()
            assert heights(mine) == pytest.approx(heights(theirs))
            words = [text.get_text() for text in mine.get_yticklabels()]
            assert words == [text.get_text() for text in theirs.get_yticklabels()]


def test_candidates_are_ranked_with_what_each_closes(diagnosed):
    diagnosis, _ = diagnosed
    (axes,) = plots.gap_candidates(diagnosis).axes
    finding = diagnosis.findings[0]
    names = [text.get_text() for text in axes.get_yticklabels()]
    assert names[0] == finding.label
    bars = {round(bar.get_y() + bar.get_height() / 2): bar.get_width() for bar in axes.patches}
    assert bars[0] == pytest.approx(finding.gain)
    for place, other in enumerate(finding.runners_up[:5], start=1):
        assert names[place] == other.label
        assert bars[place] == pytest.approx(max(other.gain, 0.0))


def test_where_the_gap_is_names_the_parts_that_are_more_than_noise(diagnosed):
    diagnosis, _ = diagnosed
    figure = plots.gap_where(diagnosis)
    panel = next(axes for axes in figure.axes if axes.get_title() == "by line")
    shares = [one for one in diagnosis.map if one.split == "line"]
    drawn = sorted((bar.get_x() + 0.375, bar.get_height()) for bar in panel.patches)
    np.testing.assert_allclose([height for _, height in drawn], [s.rms * 1e6 for s in shares])
    assert "noise of a stop" in panel.get_legend_handles_labels()[1]


def test_the_gap_before_and_after_in_figures(diagnosed):
    _, summary = diagnosed
    rms, largest, squares = plots.gap_figures(summary).axes
    assert heights(rms) == pytest.approx([summary.before.rms * 1e6, summary.after.rms * 1e6])
    expected = [summary.before.largest * 1e6, summary.after.largest * 1e6]
    assert heights(largest) == pytest.approx(expected)
    assert heights(squares)[0] == pytest.approx(
        summary.before.chi_squared / summary.before.degrees_of_freedom
    )


def test_nothing_found_has_no_after(diagnosed):
    _, summary = diagnosed
    nothing = replace(summary, findings=(), partial=(), map=())
    for function in (plots.gap_where, plots.gap_candidates, plots.gap_figures):
        assert function(nothing) is None


def test_changes_draw_both_curves_with_e_n_below():
    before, after = make_result(), make_result(shift=4e-7)
    found = compare(ComparedMeasurement(before), ComparedMeasurement(after))
    figure = plots.changes(found)
    assert len(figure.axes) == 18
    upper = next(axes for axes in figure.axes if axes.get_title().startswith("E_YX"))
    lower = figure.axes[figure.axes.index(upper) + 3]
    one = next(one for one in found.curves if one.name == "E_YX")
    lines = {line.get_label(): line for line in upper.get_lines()}
    np.testing.assert_allclose(lines["before"].get_ydata(), one.before * 1e6)
    np.testing.assert_allclose(lines["after"].get_ydata(), one.after * 1e6)
    band = upper.collections[0].get_paths()[0].vertices[:, 1]
    assert band.max() == pytest.approx(np.nanmax(one.before + 2.0 * one.before_uncertainty) * 1e6)
    errors = {line.get_label(): line for line in lower.get_lines()}
    np.testing.assert_allclose(errors["E_n"].get_ydata(), one.normalised_error)
    outside = np.abs(one.normalised_error) > 1.0
    assert np.any(outside)
    np.testing.assert_allclose(errors["E_n beyond ±1"].get_ydata(), one.normalised_error[outside])
    assert lower.get_xlim() == upper.get_xlim()
    with refused(Refusal, "mismatch", "E_AX"):
        plots.changes(found, ["E_AX"])


def test_the_visibility_of_every_error_is_drawn_with_its_verdict():
    seen = visibility(load_plan("quick")[0], "YXZ", 1e-7)
    figure = plots.visibility(seen)
    assert [axes.get_title().split(" ")[0] for axes in figure.axes] == [
        "Translations",
        "Rotations",
        "Squareness",
    ]
    words = {
        text.get_text().split("\n")[0]: text.get_text().split("\n")[1]
        for axes in figure.axes
        for text in axes.texts
    }
    assert words.keys() == {row.name for row in seen.rows}
    for row in seen.rows:
        known = np.isfinite(row.end) or np.isfinite(row.largest)
        assert (words[row.name] == "unknown") == (not known)
    labels = {text.get_text() for text in figure.texts}
    assert {row.status for row in seen.rows} <= labels
    without = plots.visibility(visibility(load_plan("quick")[0], "", 1e-7))
    assert len(without.axes) == 2
    assert any("rotations were not looked at" in text.get_text() for text in without.texts)


def test_what_tables_leave_is_drawn_in_both_directions():
    place = np.linspace(0.0, 0.1, 5)
    before = np.stack([np.outer(place, (1e-5, 2e-5, 3e-5)) + half for half in (1e-7, -1e-7)])
    axes = tuple(AxisRemainder(axis, place, before, before / 10.0) for axis in range(3))
    changes = (
        BeforeAndAfter("volume, rms", "m", 3e-6, 3e-7, True),
        BeforeAndAfter("volume, largest", "m", 6e-6, float("nan"), True),
    )
    control = SimpleNamespace(title="a control", corrects=("E_XX",))
    figure = plots.compensation(Remainder(axes, changes, 8, 8, float("nan")), control)
    panel = figure.axes[0]
    lines = {line.get_label(): line for line in panel.get_lines()}
    for label, values in (
        ("before", before[0]),
        ("before, backward", before[1]),
        ("after (computed)", before[0] / 10.0),
    ):
        np.testing.assert_allclose(lines[label].get_ydata(), values[:, 0] * 1e6)
    assert figure.axes[1].get_title().endswith("(no table)")
    assert len(legend_entries(figure.axes)) == 4
    alike = np.stack([before[0], before[0]])
    axes = tuple(AxisRemainder(axis, place, alike, alike / 10.0) for axis in range(3))
    single = plots.compensation(Remainder(axes, changes, 8, 8, float("nan")), control)
    assert list(legend_entries(single.axes)) == ["before", "after (computed)"]
    said = [text.get_text() for text in figure.texts]
    assert "volume: rms 3.000 µm → 0.300 µm, largest 6.000 µm → unknown" in said


def test_a_described_rotation_is_drawn_in_microradians_over_what_it_depends_on():
    def turning(stops):
        turn = np.zeros_like(stops.position)
        turn[:, 0] = 100e-6 * stops.share[:, 0] * stops.time / stops.duration
        return Change(rotations={0: turn}).readings(stops)

    figure = plots.gap_dependences(diagnose(hidden_run(shape=turning)))
    panels = figure.axes
    assert [panel.get_title(loc="left") or panel.get_title() for panel in panels[:2]] == [
        "rotation E_AX / µrad"
    ] * 2
    (formula,) = [one for one in panels[0].containers if one.get_label().startswith("formula")]
    largest = np.max(np.abs(formula.lines[0].get_ydata()))
    assert 60.0 < largest < 110.0
