"""Writes a report into a results folder: JSON, text and pictures."""

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from stepdiag_ros.report.content import Report
from stepdiag_ros.report.documents import report_json
from stepdiag_ros.report.squareness import SignDefinition
from stepdiag_ros.report.tables import make_console, print_report

PICTURE_FORMATS = ("png", "svg", "pdf")


def results_folder(bag: Path) -> Path:
    """Return the folder for the results of a bag: ``NAME_results`` beside it."""
    return bag.with_name(f"{bag.stem}_results")


@contextmanager
def _whole_file(path: Path) -> Iterator[Path]:
    """Give a name to write to and rename it at the end: no half-written file is ever found."""
    partial = path.with_name(f".partial-{path.name}")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def publish(
    report: Report,
    folder: Path,
    picture_formats: tuple[str, ...] = ("png",),
    definition: SignDefinition = "rotation",
    progress: Callable[[str], None] | None = None,
) -> list[Path]:
    """Write ``results.json``, ``report.txt`` and the pictures, in place of earlier ones.

    Args:
        report: what is written.
        folder: made if it is not there.
        picture_formats: any of ``PICTURE_FORMATS``; none leaves the pictures out.
        definition: sign definition of squareness in the text and the pictures; the JSON always
            holds the right-handed rotation.
        progress: called with the name of each file before it is made.

    Returns:
        The files, in the order in which they were written.

    Raises:
        ValueError: an unknown picture format, or the report contradicts itself.
        OSError: a file cannot be written.
    """
    for picture_format in picture_formats:
        if picture_format not in PICTURE_FORMATS:
            raise ValueError(
                f"there is no picture format '{picture_format}': use {', '.join(PICTURE_FORMATS)}"
            )
    text = io.StringIO()
    print_report(report, make_console(text), definition)
    written: list[Path] = []
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in (
        ("results.json", report_json(report) + "\n"),
        ("report.txt", _without_trailing_blanks(text.getvalue())),
    ):
        if progress is not None:
            progress(name)
        with _whole_file(folder / name) as partial:
            partial.write_text(content, encoding="utf-8")
        written.append(folder / name)
    if picture_formats:
        # matplotlib is slow to import, so it is only here that pictures are asked for.
        from stepdiag_ros.report.figures import draw_all, save

        for name, picture in draw_all(report, definition).items():
            for picture_format in picture_formats:
                path = folder / f"{name}.{picture_format}"
                if progress is not None:
                    progress(path.name)
                with _whole_file(path) as partial:
                    save(picture, partial)
                written.append(path)
    return written


def _without_trailing_blanks(text: str) -> str:
    return "".join(f"{line.rstrip()}\n" for line in text.splitlines())
