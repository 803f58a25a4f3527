"""The one look: what every figure has, how it is saved, and that the quick scales are right."""

import subprocess
import sys
from io import BytesIO
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image
from refused import refused
from results_by_hand import make_result

from stepdiag_ros import plots
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers import solvers
from stepdiag_ros.plots import style
from stepdiag_ros.plots.places import HALF, WIDTH, printed_at
from stepdiag_ros.plots.style import Sheet, say_unknown


def rendered(figure):
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


@pytest.fixture(scope="module")
def figure():
    return plots.error_curves(make_result(), ["E_XX", "E_YX"], stamp="plan, run 1")


@pytest.mark.parametrize(
    ("ending", "start"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")]
)
def test_figures_are_written_in_the_format_of_their_ending(figure, ending, start, tmp_path):
    path = tmp_path / f"curves.{ending}"
    plots.save(figure, path)
    assert path.read_bytes().startswith(start)


def test_another_ending_is_refused(figure, tmp_path):
    with refused(Refusal, "unknown", ".png", ".svg", ".pdf"):
        plots.save(figure, tmp_path / "curves.bmp")


def test_svg_is_one_element_with_words_as_words_and_the_same_each_time(figure):
    text = plots.svg_text(figure)
    root = ElementTree.fromstring(text)
    assert root.tag.endswith("svg")
    words = {"".join(one.itertext()).strip() for one in root.iter() if one.tag.endswith("text")}
    assert {"E_XX: X error as X moves", "X / mm", "plan, run 1"} <= words
    assert plots.svg_text(figure) == text
    names = [one.get("id") for one in root.iter() if one.get("id")]
    others = ElementTree.fromstring(plots.svg_text(figure, salt="another"))
    assert not set(names) & {one.get("id") for one in others.iter() if one.get("id")}


def test_png_has_the_asked_resolution(figure):
    dots = figure.dpi
    shown = Image.open(BytesIO(plots.png_bytes(figure, dpi=100)))
    assert shown.size[0] == round(100 * WIDTH)
    assert figure.dpi == dots


def test_png_for_a_page_has_the_pixels_that_matplotlib_saves_without_transparency(figure):
    ours, theirs = BytesIO(plots.png_bytes(figure)), BytesIO()
    figure.savefig(theirs, format="png", dpi=style.DOTS_PER_INCH)
    shown, saved = Image.open(ours), np.asarray(Image.open(theirs))
    assert shown.mode == "RGB"
    assert np.array_equal(shown, saved[..., :3]) and np.all(saved[..., 3] == 255)


def test_a_notebook_shows_a_figure_without_pyplot(figure):
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_scales_say_what_matplotlib_would(figure):
    panel = figure.axes[0]
    figure.canvas.draw()
    values, words = panel.xaxis.places()
    low, high = panel.get_xlim()
    assert len(values) >= 3 and low <= values.min() and values.max() <= high
    assert [float(word.replace("\N{MINUS SIGN}", "-")) for word in words] == pytest.approx(values)


@pytest.mark.parametrize("values", [(100_900.0, 100_900.2), (3e6, 9e6), (1e-5, 9e-5)])
def test_numbers_are_written_in_full_without_offset_or_power_of_ten(values):
    sheet = Sheet(1, 1, 1.0)
    sheet.panels[0].plot([0, 1], values)
    places, words = sheet.panels[0].yaxis.places()
    assert len(places) >= 3
    assert [float(word) for word in words] == pytest.approx(list(places), rel=1e-9)


def test_places_and_words_of_a_scale_can_be_given():
    sheet = Sheet(1, 1, 1.0)
    (panel,) = sheet.panels
    panel.bar([0, 1], [2.0, 3.0])
    panel.set_xticks([0, 1], ["one", "two"])
    values, words = panel.xaxis.places()
    assert list(values) == [0, 1] and words == ["one", "two"]
    sheet.finish("Bars")


def test_a_grid_line_is_drawn_where_its_number_says():
    sheet = Sheet(1, 1, 1.0)
    (panel,) = sheet.panels
    panel.set_xlim(0.0, 4.0)
    panel.set_xticks([1.0, 3.0])
    panel.yaxis.gridded = False
    panel.set_yticks([])
    figure = sheet.finish(legend=False)
    picture = rendered(figure)[..., 0].astype(int)
    box = panel.get_window_extent()
    row = picture[picture.shape[0] - round((box.y0 + box.y1) / 2), round(box.x0) + 4 :]
    dark = np.flatnonzero(row[: round(box.width) - 8] < 250) + round(box.x0) + 4
    for value in (1.0, 3.0):
        place = panel.transData.transform((value, 0.0))[0]
        assert np.min(np.abs(dark - place)) <= 1.0
    halfway = panel.transData.transform((2.0, 0.0))[0]
    assert np.min(np.abs(dark - halfway)) > 5.0


def test_shared_scales_follow_each_other():
    sheet = Sheet(3, 3, 1.0, share_up=True)
    sheet.panels[2].plot([0, 1], [-7.0, 7.0])
    assert sheet.panels[0].get_ylim() == sheet.panels[2].get_ylim()
    assert [panel.yaxis.numbered for panel in sheet.panels] == [True, False, False]


def test_nothing_stands_outside_of_the_figure(figure):
    figure.canvas.draw()
    width, height = figure.get_size_inches() * figure.dpi
    for text in figure.texts:
        box = text.get_window_extent()
        assert box.x0 >= 0 and box.x1 <= width and box.y0 >= 0 and box.y1 <= height, text


def test_a_figure_for_half_a_page_is_smaller_and_its_words_are_not():
    def made():
        return Sheet(3, 3, 1.5).finish("What is drawn", small_print=["A remark below it."])

    whole = made()
    with printed_at(HALF):
        half = made()
    assert half.get_figwidth() == pytest.approx(HALF.share * WIDTH)
    assert half.get_figheight() < whole.get_figheight()
    sizes = [[text.get_fontsize() for text in one.texts] for one in (whole, half)]
    assert len(sizes[0]) == 2 and sizes[0] == sizes[1]


def test_a_long_legend_is_broken_into_rows_that_fit():
    sheet = Sheet(1, 1, 1.0)
    for number in range(7):
        sheet.panels[0].plot([0, 1], [number, 1], label=f"a rather long name of curve {number}")
    figure = sheet.finish("Seven")
    width = figure.get_size_inches()[0] * figure.dpi
    rows = {}
    for text in figure.texts[1:]:
        box = text.get_window_extent()
        assert box.x1 <= width
        rows.setdefault(round(box.y0), []).append(text)
    assert len(rows) >= 2


def test_an_unknown_panel_is_hatched():
    sheet = Sheet(1, 1, 1.0)
    say_unknown(sheet.panels[0])
    figure = sheet.finish(legend=False)
    assert np.ptp(rendered(figure)[..., 0]) > 50
    assert [text.get_text() for text in sheet.panels[0].texts] == [style.NOT_DETERMINED]


def test_colours_differ_in_grey_or_by_marker_and_line():
    looks = {(one.marker, one.line) for one in map(style.style_of, solvers())}
    assert len(looks) == len(solvers())
    assert style.style_of("a method of nobody") == style.OTHER
    assert (style.BEFORE.line, style.BEFORE.marker) != (style.AFTER.line, style.AFTER.marker)


def test_the_stamp_tells_what_is_known():
    assert plots.stamp(run_id="7", plan="demo") == "demo, run 7"
    assert plots.stamp(plan="demo") == "demo"
    assert plots.stamp() == ""


def test_every_figure_can_be_asked_for_and_nothing_is_imported_before():
    script = (
        "import sys, stepdiag_ros; slow = ('numpy', 'scipy', 'matplotlib', 'rosbags');"
        "print([name for name in slow if name in sys.modules]);"
        "from stepdiag_ros import plots; print('matplotlib' in sys.modules);"
        "print([name for name in plots.__all__ if getattr(plots, name) is None]);"
        "print([n for n in plots._HOMES if not callable(getattr(plots, n))])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout.splitlines() == ["[]", "False", "[]", "[]"]
    with refused(AttributeError, None, "pie"):
        _ = plots.pie
