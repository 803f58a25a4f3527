"""Writes a report into a results folder: JSON, text and pictures."""

import io
from collections.abc import Callable, Collection, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.evaluation.experiment import Experiment, experiment_of
from stepdiag_ros.evaluation.report import Report
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.plots.formats import PICTURE_FORMATS
from stepdiag_ros.report.documents.experiment import experiment_json
from stepdiag_ros.report.documents.run import report_json
from stepdiag_ros.report.files import make_folder, whole_file, without_trailing_blanks
from stepdiag_ros.report.tables.run import print_report
from stepdiag_ros.text.console import make_console
from stepdiag_ros.words.squareness import SignDefinition

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

_ENDINGS = (*PICTURE_FORMATS, "html")
# The names stand here, not beside what draws them: matplotlib is slow to import.
RUN_PICTURES = (
    *("worst_error", "error_curves", "error_curves_by_method", "error_curves_with_conventional"),
    *("rotations", "squareness", "repeatability"),
)
"""Names of all pictures of ``plots.files.run``."""
EXPERIMENT_PICTURES = (
    *("figure_7_motion_of_x", "figure_8_motion_of_y", "figure_9_motion_of_z", "figure_10_angles"),
    *("line_errors", "direct_comparison"),
)
"""Names of all pictures of ``plots.files.experiment``."""
DIAGNOSIS_PICTURES = (
    *(
        "diagnosis",
        "gap_map",
        "gap_where",
        "dependences",
        "candidates",
        "gap_traces",
        "held_out",
        "curves",
    ),
)
"""Names of the page of a diagnosis and of all pictures of ``plots.files.diagnosis``."""


def publish(
    report: Report,
    folder: Path,
    picture_formats: tuple[str, ...] = ("png",),
    definition: SignDefinition = "rotation",
    progress: Callable[[float, str], None] | None = None,
    all_methods: bool = False,
    pictures: Callable[[], Mapping[str, bytes]] | None = None,
) -> list[Path]:
    """Write ``results.json``, ``report.txt`` and the pictures, in place of earlier ones.

    Args:
        report: what is written.
        folder: made if it is not there.
        picture_formats: any of ``PICTURE_FORMATS``; none leaves the pictures out.
        definition: sign definition of squareness in the text and the pictures; the JSON always
            holds the right-handed rotation.
        progress: called before each file with the part that is done (0..1) and the file's name.
        all_methods: draw also the error curves of all methods beside each other.
        pictures: returns what ``drawn_pictures`` does, from another process; None: drawn here.

    Returns:
        The files, in the order in which they were written.

    Raises:
        ValueError: an unknown picture format, the folder cannot be made, or the report contradicts
            itself.
        OSError: a file cannot be written.
    """
    text = io.StringIO()
    print_report(report, make_console(text), definition)
    contents: dict[str, str | bytes] = {
        "results.json": report_json(report) + "\n",
        "report.txt": text.getvalue(),
    }
    experiment = experiment_of(report)
    if experiment is not None:
        contents.update(experiment_texts(experiment))
    if progress is not None:
        progress(0.0, "pictures")
    draw = pictures or partial(drawn_pictures, report, picture_formats, definition, all_methods)
    contents.update(draw())
    names = (*RUN_PICTURES, *EXPERIMENT_PICTURES)
    return write_results(folder, contents, dict, (), progress, names)


def drawn_pictures(
    report: Report,
    picture_formats: tuple[str, ...],
    definition: SignDefinition = "rotation",
    all_methods: bool = False,
) -> dict[str, bytes]:
    """Return the pictures of a report by the names of their files; arguments as of ``publish``.

    Raises:
        ValueError: an unknown picture format.
    """
    _check_formats(picture_formats)
    if not picture_formats:
        return {}
    # matplotlib is slow to import, so it is only here that pictures are asked for.
    from stepdiag_ros.plots.files.experiment import draw_experiment
    from stepdiag_ros.plots.files.run import draw_all
    from stepdiag_ros.plots.saving import file_bytes

    experiment = experiment_of(report)
    figures = draw_all(report, definition, all_methods)
    if experiment is not None:
        figures |= draw_experiment(experiment)
    return {
        f"{name}.{picture_format}": file_bytes(figure, picture_format)
        for name, figure in figures.items()
        for picture_format in picture_formats
    }


def get_ready_to_draw() -> None:
    """Import what ``drawn_pictures`` needs."""
    import stepdiag_ros.plots.files.experiment
    import stepdiag_ros.plots.files.run
    import stepdiag_ros.plots.saving  # noqa: F401


def _check_formats(picture_formats: tuple[str, ...]) -> None:
    for picture_format in picture_formats:
        if picture_format not in PICTURE_FORMATS:
            raise Refusal(
                f"there is no picture format '{picture_format}': use {', '.join(PICTURE_FORMATS)}",
                fault="unknown",
            )


def write_results(
    folder: Path,
    contents: Mapping[str, str | bytes],
    draw: "Callable[[], Mapping[str, Picture | bytes]]",
    picture_formats: tuple[str, ...] = ("png",),
    progress: Callable[[float, str], None] | None = None,
    names: Collection[str] = (),
) -> list[Path]:
    """Write texts and pictures into a results folder, in place of earlier ones.

    Args:
        folder: made if it is not there.
        contents: name of a file → its text, without blanks at the ends of lines, or its bytes.
        draw: returns the pictures by the names of their files without ending, those that are
            finished in their format as bytes; only called if pictures are wanted.
        picture_formats: any of ``PICTURE_FORMATS``; none leaves the pictures out.
        progress: called before each file with the part that is done (0..1) and the file's name.
        names: of all pictures and pages that such results may have, without ending. Where the
            folder holds the first of ``contents`` already, those of them that are not written again
            are deleted: they would belong to the earlier results.

    Returns:
        The files, in the order in which they were written.

    Raises:
        ValueError: an unknown picture format, or the folder cannot be made.
        OSError: a file cannot be written.
    """
    _check_formats(picture_formats)
    tell = progress or _tell_nobody
    pictures: dict[str, Picture | bytes] = {}
    if picture_formats:
        from stepdiag_ros.plots.saving import save

        tell(0.0, "pictures")
        pictures = {
            f"{name}.{picture_format}": picture
            for name, picture in draw().items()
            for picture_format in picture_formats
        }
    make_folder(folder)
    earlier: list[Path] = []
    if any((folder / name).is_file() for name in list(contents)[:1]):
        earlier = [folder / f"{name}.{ending}" for name in names for ending in _ENDINGS]
    written: list[Path] = []
    for name in (*contents, *pictures):
        tell(len(written) / (len(contents) + len(pictures)), name)
        with whole_file(folder / name) as file:
            content = pictures[name] if name in pictures else contents[name]
            if isinstance(content, str):
                file.write_text(without_trailing_blanks(content), encoding="utf-8")
            elif isinstance(content, bytes):
                file.write_bytes(content)
            else:
                save(content, file)
        written.append(folder / name)
    for path in {*earlier} - {*written}:
        path.unlink(missing_ok=True)
    return written


def _tell_nobody(done: float, name: str) -> None:
    del done, name


def experiment_texts(experiment: Experiment) -> dict[str, str]:
    """Return the files ``table_1.txt`` and ``table_1.json`` by their names."""
    from stepdiag_ros.report.tables.experiment import print_experiment
    from stepdiag_ros.text.console import make_console

    text = io.StringIO()
    print_experiment(experiment, make_console(text))
    return {"table_1.txt": text.getvalue(), "table_1.json": experiment_json(experiment) + "\n"}
