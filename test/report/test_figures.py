"""The pictures: what is drawn, and that the files are what they claim to be."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from results_by_hand import (
    make_measurement,
    make_report,
    make_result,
    with_rotations,
    with_unknown,
)

from stepdiag_ros.metrology.geometry import ROTATIONS
from stepdiag_ros.report.figures import (
    curves_picture,
    draw_all,
    lines_picture,
    rotations_picture,
    save,
    squareness_picture,
)
from stepdiag_ros.report.publish import publish


def drawn_lines(axes):
    return {line.get_label(): line for line in axes.get_lines() if line.get_label()[0] != "_"}


def test_nine_panels_with_curves_bands_and_truth():
    picture = curves_picture(make_report(), with_conventional=True)
    assert len(picture.axes) == 9
    panel = next(axes for axes in picture.axes if axes.get_title().startswith("E_ZX"))
    assert panel.get_title() == "E_ZX: Z error as X moves"
    lines = drawn_lines(panel)
    assert list(lines) == [
        "Conventional (Wang)",
        "Setup-robust (Ibaraki & Hata)",
        "Least squares",
        "Truth (simulated cell)",
    ]
    result = make_result("least_squares", shift=2e-8)
    np.testing.assert_allclose(lines["Least squares"].get_xdata(), result.nodes[0] * 1e3)
    np.testing.assert_allclose(lines["Least squares"].get_ydata(), result.curves["E_ZX"] * 1e6)
    band = panel.collections[-1].get_paths()[0].vertices[:, 1]
    assert band.max() == pytest.approx(
        np.max(result.curves["E_ZX"] + 1.96 * result.standard_uncertainty["E_ZX"]) * 1e6
    )
    assert len(panel.collections) == 3


def test_the_conventional_result_does_not_hide_the_rest():
    picture = curves_picture(make_report(), with_conventional=False)
    for panel in picture.axes:
        assert "Conventional (Wang)" not in drawn_lines(panel)
        assert max(np.abs(panel.get_ylim())) < 2.0


def test_a_curve_that_is_not_determined_is_said_and_not_drawn():
    picture = curves_picture(
        make_report(results=(with_unknown(make_result()),), truth=None), with_conventional=False
    )
    panel = next(axes for axes in picture.axes if axes.get_title().startswith("E_YZ"))
    assert not drawn_lines(panel)
    assert [text.get_text() for text in panel.texts] == ["not determined"]


def test_a_curve_known_only_where_the_frame_fixes_it_is_not_drawn():
    result = with_unknown(make_result())
    result.curves["E_YZ"][0] = result.standard_uncertainty["E_YZ"][0] = 0.0
    report = make_report(results=(result,), truth=None)
    picture = curves_picture(report, with_conventional=False)
    panel = next(axes for axes in picture.axes if axes.get_title().startswith("E_YZ"))
    assert [text.get_text() for text in panel.texts] == ["not determined"]
    assert not drawn_lines(panel)


def test_rotations_have_nine_panels_of_their_own_in_microradians():
    assert rotations_picture(make_report()) is None
    result = with_rotations(make_result())
    picture = rotations_picture(make_report(results=(result, make_result())))
    titles = [panel.get_title() for panel in picture.axes]
    assert titles[:2] == ["E_AX: rotation about X as X moves", "E_AY: rotation about X as Y moves"]
    assert picture.axes[0].get_ylabel() == "error / µrad"
    lines = drawn_lines(picture.axes[1])
    assert list(lines) == ["Rigid body (all 21 errors)"]
    drawn = lines["Rigid body (all 21 errors)"].get_ydata()
    np.testing.assert_allclose(drawn, result.curves["E_AY"] * 1e6)
    hidden = next(panel for panel in picture.axes if panel.get_title().startswith("E_BY"))
    assert [text.get_text() for text in hidden.texts] == ["not determined"]
    unknown = with_rotations(make_result(), unknown=ROTATIONS)
    assert rotations_picture(make_report(results=(unknown,))) is None


def test_squareness_that_is_not_known_is_not_drawn():
    unknown = tuple(
        replace(figure, value=float("nan"))
        for figure in make_result().figures
        if figure.unit == "rad"
    )
    report = make_report(results=(replace(make_result(), figures=unknown),))
    picture = squareness_picture(report)
    for panel in picture.axes:
        assert "Least squares" not in drawn_lines(panel)
        words = "\n".join(text.get_text() for text in panel.texts).splitlines()
        assert "Least squares: unknown" in words
    assert "Truth (simulated cell): 12.00 µm/m" in picture.axes[0].texts[-1].get_text()
    truth = drawn_lines(picture.axes[0])["Truth (simulated cell)"]
    assert truth.get_xdata()[-1] < -0.1


def test_squareness_leans_the_way_it_is():
    picture = squareness_picture(make_report())
    ends = {}
    for panel in picture.axes:
        line = drawn_lines(panel)["Least squares"]
        ends[panel.get_title()[:3]] = line.get_xdata()[-1]
    # Positive rotation: +Y leans to -X seen from +Z, +Z to +X seen from -Y, +Z to -Y seen from +X.
    assert ends["C0Y"] < -0.1
    assert ends["B0Z"] > 0.1
    assert ends["A0Z"] < -0.1
    other = squareness_picture(make_report(), "angle")
    for panel in other.axes:
        assert drawn_lines(panel)["Least squares"].get_xdata()[-1] == ends[panel.get_title()[:3]]


def test_repeatability_shows_backward_turned_round():
    picture = lines_picture(make_report(measurement=make_measurement()))
    assert [panel.get_title() for panel in picture.axes if panel.get_visible()] == ["x", "ppp XYZ"]
    for panel in picture.axes:
        for line in drawn_lines(panel).values():
            np.testing.assert_allclose(line.get_ydata(), 0.0, atol=1e-9)
    assert lines_picture(make_report()) is None


@pytest.mark.parametrize(
    ("ending", "start"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")]
)
def test_pictures_are_written_in_the_format_of_their_ending(ending, start, tmp_path):
    path = tmp_path / f"squareness.{ending}"
    save(squareness_picture(make_report()), path)
    assert path.read_bytes().startswith(start)


def test_another_ending_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"\.png, \.svg or \.pdf"):
        save(squareness_picture(make_report()), tmp_path / "squareness.bmp")


def test_which_pictures_there_are():
    assert list(draw_all(make_report(measurement=make_measurement()))) == [
        "error_curves",
        "error_curves_with_conventional",
        "squareness",
        "repeatability",
    ]
    assert list(draw_all(make_report(results=()))) == []


def test_drawing_leaves_no_global_state_behind():
    before = "matplotlib.pyplot" in sys.modules
    draw_all(make_report())
    assert ("matplotlib.pyplot" in sys.modules) == before


def test_publish_writes_whole_files_only(tmp_path, monkeypatch):
    files = publish(make_report(), tmp_path / "new" / "folder")
    assert [path.name for path in files] == [
        "results.json",
        "report.txt",
        "error_curves.png",
        "error_curves_with_conventional.png",
        "squareness.png",
    ]
    assert sorted(path.name for path in (tmp_path / "new" / "folder").iterdir()) == sorted(
        path.name for path in files
    )

    def full_disk(_, path):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("stepdiag_ros.report.figures.save", full_disk)
    with pytest.raises(OSError, match="No space"):
        publish(make_report(), tmp_path / "full")
    assert sorted(path.name for path in (tmp_path / "full").iterdir()) == [
        "report.txt",
        "results.json",
    ]


def test_publish_refuses_an_unknown_picture_format(tmp_path):
    with pytest.raises(ValueError, match="'bmp'"):
        publish(make_report(), tmp_path, ("bmp",))
