"""Which pictures a report has, and that files are written whole; test/plots looks at each."""

import errno
import sys
from dataclasses import replace
from pathlib import Path

from refused import refused
from results_by_hand import make_measurement, make_report, make_result, with_rotations

from stepdiag_ros.metrology.geometry import ROTATIONS
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.plots.files.run import draw_all
from stepdiag_ros.report.publish import publish


def test_which_pictures_there_are():
    report = make_report(measurement=make_measurement())
    usual = ["worst_error", "error_curves", "squareness", "repeatability"]
    assert list(draw_all(report)) == usual
    further = {"error_curves_by_method", "error_curves_with_conventional"}
    assert set(draw_all(report, all_methods=True)) == {*usual, *further}
    assert list(draw_all(make_report(results=()))) == []


def test_one_method_is_drawn_with_the_true_errors_where_they_are_known():
    report = make_report()
    labels = draw_all(report)["error_curves"].axes[0].get_legend_handles_labels()[1]
    assert labels == ["Least squares", "Truth (simulated cell)"]
    unknown = draw_all(replace(report, truth=None))["error_curves"]
    assert unknown.axes[0].get_legend_handles_labels()[1] == ["Least squares"]


def test_rotations_are_drawn_where_one_is_determined():
    turning = with_rotations(make_result())
    assert "rotations" in draw_all(make_report(results=(turning,)))
    unknown = with_rotations(make_result(), unknown=ROTATIONS)
    assert "rotations" not in draw_all(make_report(results=(unknown,)))


def test_the_conventional_result_does_not_hide_the_rest():
    pictures = draw_all(make_report(), all_methods=True)
    for panel in pictures["error_curves_by_method"].axes:
        assert "Conventional (Wang)" not in panel.get_legend_handles_labels()[1]
        assert max(map(abs, panel.get_ylim())) < 2.0
    with_it = pictures["error_curves_with_conventional"].axes[0]
    assert "Conventional (Wang)" in with_it.get_legend_handles_labels()[1]


def test_drawing_leaves_no_global_state_behind():
    before = "matplotlib.pyplot" in sys.modules
    draw_all(make_report())
    assert ("matplotlib.pyplot" in sys.modules) == before


def test_publish_writes_whole_files_only(tmp_path, monkeypatch):
    files = publish(make_report(), tmp_path / "new" / "folder")
    assert [path.name for path in files] == [
        "results.json",
        "report.txt",
        "worst_error.png",
        "error_curves.png",
        "squareness.png",
    ]
    assert sorted(path.name for path in (tmp_path / "new" / "folder").iterdir()) == sorted(
        path.name for path in files
    )

    def full_disk(path, content):
        with path.open("wb") as file:
            file.write(content[: len(content) // 2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full_disk)
    with refused(OSError, errno=errno.ENOSPC):
        publish(make_report(), tmp_path / "full")
    assert sorted(path.name for path in (tmp_path / "full").iterdir()) == [
        "report.txt",
        "results.json",
    ]


def test_publish_refuses_an_unknown_picture_format(tmp_path):
    with refused(Refusal, "unknown", "bmp"):
        publish(replace(make_report(), truth=None), tmp_path, ("bmp",))
