"""Error curves and squareness: what is drawn is what the result says."""

from dataclasses import replace

import numpy as np
import pytest
from refused import refused
from results_by_hand import make_report, make_result, with_rotations, with_unknown

from stepdiag_ros import plots
from stepdiag_ros.metrology.geometry import ROTATIONS, SQUARENESS
from stepdiag_ros.metrology.refusal import Refusal

TITLES = ["Conventional (Wang)", "Setup-robust (Ibaraki & Hata)", "Least squares"]
TRUTH = "Truth (simulated cell)"


def drawn_lines(axes):
    return {line.get_label(): line for line in axes.get_lines() if line.get_label()[0] != "_"}


def panel_of(figure, name):
    return next(axes for axes in figure.axes if axes.get_title().startswith(name))


def words_in(axes):
    return [text.get_text() for text in axes.texts]


@pytest.fixture(scope="module")
def report():
    return make_report()


@pytest.fixture(scope="module")
def nine(report):
    return plots.error_curves(report.ordered_results(), truth=report.truth, stamp="a plan, run 7")


def test_nine_panels_with_curves_bands_and_truth(nine):
    assert len(nine.axes) == 9
    panel = panel_of(nine, "E_ZX")
    assert panel.get_title() == "E_ZX: Z error as X moves"
    lines = drawn_lines(panel)
    assert list(lines) == [*TITLES, TRUTH]
    result = make_result("least_squares", shift=2e-8)
    np.testing.assert_allclose(lines["Least squares"].get_xdata(), result.nodes[0] * 1e3)
    np.testing.assert_allclose(lines["Least squares"].get_ydata(), result.curves["E_ZX"] * 1e6)
    bands = panel.collections
    assert len(bands) == 3
    top = result.curves["E_ZX"] + 1.96 * result.standard_uncertainty["E_ZX"]
    assert bands[-1].get_paths()[0].vertices[:, 1].max() == pytest.approx(np.max(top) * 1e6)


def test_scales_have_units_and_columns_are_the_moving_axis(nine):
    assert [axes.get_title()[:4] for axes in nine.axes[:3]] == ["E_XX", "E_XY", "E_XZ"]
    assert [axes.get_xlabel() for axes in nine.axes[6:]] == ["X / mm", "Y / mm", "Z / mm"]
    assert nine.axes[0].get_ylabel() == "error / µm"


def test_panels_of_a_row_share_their_scale_and_rows_differ(nine):
    for row in range(3):
        limits = {axes.get_ylim() for axes in nine.axes[3 * row : 3 * row + 3]}
        assert len(limits) == 1
        assert [axes.yaxis.numbered for axes in nine.axes[3 * row : 3 * row + 3]] == [
            True,
            False,
            False,
        ]
    mixed = plots.error_curves(with_rotations(make_result()), ["E_XX", "E_AX"])
    assert mixed.axes[0].get_ylim() != mixed.axes[1].get_ylim()
    assert mixed.axes[1].yaxis.numbered, "another unit has a scale of its own"


def test_the_legend_is_clear_of_the_small_print_and_of_the_scales(nine):
    height = float(nine.get_figheight())
    places = {text.get_text(): text.get_position()[1] * height for text in nine.texts}
    legend = [places[label] for label in (*TITLES, TRUTH)]
    letters = 7.5 / 72.0
    frames = [at for words, at in places.items() if words.startswith("Frame")]
    assert min(legend) - 0.5 * letters - max(frames) > 0.05
    below = min(axes.get_position().y0 for axes in nine.axes) * height
    assert below - max(legend) > 0.35, "numbers and names of the scales stand between"


def test_heading_legend_frame_and_stamp_stand_once(nine, report):
    said = [text.get_text() for text in nine.texts]
    assert said[0] == "Translational errors of the axes with 95 % coverage intervals"
    for label in (*TITLES, TRUTH):
        assert said.count(label) == 1
    assert said[-1] == "a plan, run 7"
    assert any(one.startswith("Frame: ") for one in said)
    bare = plots.error_curves(report.preferred(), title="")
    assert not any("95 %" in text.get_text() for text in bare.texts)


def test_methods_differ_without_colour(nine):
    looks = {
        (line.get_marker(), line.get_linestyle()) for line in drawn_lines(nine.axes[0]).values()
    }
    assert len(looks) == 4


def test_some_curves_alone_and_rotations_in_microradians():
    two = plots.error_curves(make_result(), ["E_YX", "E_ZY"])
    assert [axes.get_title()[:4] for axes in two.axes] == ["E_YX", "E_ZY"]
    result = with_rotations(make_result())
    turning = plots.error_curves([result, make_result()], ROTATIONS)
    titles = [axes.get_title() for axes in turning.axes[:2]]
    assert titles == ["E_AX: rotation about X as X moves", "E_AY: rotation about X as Y moves"]
    assert turning.axes[0].get_ylabel() == "error / µrad"
    lines = drawn_lines(turning.axes[1])
    assert list(lines) == ["Rigid body (all 21 errors)"]
    np.testing.assert_allclose(
        lines["Rigid body (all 21 errors)"].get_ydata(), result.curves["E_AY"] * 1e6
    )
    hidden = panel_of(turning, "E_BY")
    assert words_in(hidden) == ["not determined"] and hidden.patch.get_hatch()


def test_what_is_not_determined_is_hatched_and_said():
    known_by_frame = with_unknown(make_result())
    known_by_frame.curves["E_YZ"][0] = known_by_frame.standard_uncertainty["E_YZ"][0] = 0.0
    for result in (with_unknown(make_result()), known_by_frame):
        panel = panel_of(plots.error_curves(result), "E_YZ")
        assert not drawn_lines(panel)
        assert words_in(panel) == ["not determined"] and panel.patch.get_hatch()


def test_names_that_are_no_curves_and_nothing_to_draw_are_refused():
    with refused(Refusal, "unknown", "E_XQ"):
        plots.error_curves(make_result(), ["E_XQ"])
    with refused(Refusal, "too_few", "E_AX"):
        plots.error_curves(make_result(), ["E_AX"])


def test_axes_of_the_caller_are_drawn_in(report):
    from matplotlib.figure import Figure

    figure = Figure()
    mine = figure.subplots(1, 2)
    assert plots.error_curves(report.preferred(), ["E_XX", "E_YX"], axes=mine) is figure
    assert list(drawn_lines(mine[1])) == ["Least squares"]
    assert mine[1].get_xlabel() == "X / mm" and not figure.texts
    with refused(Refusal, "mismatch", "2", "1"):
        plots.error_curves(report.preferred(), ["E_XX", "E_YX"], axes=mine[0])


def test_before_and_after_are_both_drawn():
    before, after = make_result(shift=1e-6), make_result()
    figure = plots.curves_before_after(before, after)
    lines = drawn_lines(figure.axes[4])
    assert list(lines) == ["before: model as it was", "after: effects taken off"]
    for line, result in zip(lines.values(), (before, after), strict=True):
        np.testing.assert_allclose(line.get_ydata(), result.curves["E_YY"] * 1e6)


def test_squareness_leans_the_way_it_is(report):
    ends = {}
    for definition in ("rotation", "angle"):
        figure = plots.squareness(
            report.ordered_results(), truth=report.truth, definition=definition
        )
        ends[definition] = {
            axes.get_title()[:3]: drawn_lines(axes)["Least squares"].get_xdata()[-1]
            for axes in figure.axes
        }
    # Positive rotation: +Y leans to -X seen from +Z, +Z to +X seen from -Y, +Z to -Y seen from +X.
    assert ends["rotation"]["C0Y"] < -0.1
    assert ends["rotation"]["B0Z"] > 0.1
    assert ends["rotation"]["A0Z"] < -0.1
    assert ends["angle"] == ends["rotation"]


def test_the_conventional_squareness_is_told_and_not_drawn(report):
    figure = plots.squareness(report.ordered_results())
    for axes in figure.axes:
        assert "Conventional (Wang)" not in drawn_lines(axes)
        said = "\n".join(words_in(axes))
        assert "Conventional: 12.35 ± 0.49 µm/m (not drawn)" in said
        assert "Least squares: 12.35 ± 0.49 µm/m" in said
    # The reason stands below.
    assert sum("not drawn" in text.get_text().lower() for text in figure.texts) == 1
    bare = plots.squareness(report.ordered_results(), numbers=False, title="")
    assert not any("µm/m" in word for axes in bare.axes for word in words_in(axes))
    assert any("times larger" in text.get_text() for text in bare.texts)


def test_squareness_that_is_not_known_is_not_drawn(report):
    figures = tuple(
        replace(one, value=float("nan")) if one.name in SQUARENESS else one
        for one in make_result().figures
    )
    figure = plots.squareness(replace(make_result(), figures=figures), truth=report.truth)
    for axes in figure.axes:
        assert "Least squares" not in drawn_lines(axes)
        assert "Least squares: unknown" in "\n".join(words_in(axes)).splitlines()
    assert "Truth: 12.00 µm/m" in words_in(figure.axes[0])[-1]
    assert drawn_lines(figure.axes[0])[TRUTH].get_xdata()[-1] < -0.1
