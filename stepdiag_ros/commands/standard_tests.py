"""What the commands for tests by standards share: their input and their output."""

import io
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.commands.arguments import add_common, picture_formats
from stepdiag_ros.commands.output import progress_bar, run_of, say, warn_of_replaced
from stepdiag_ros.metrology.refusal import Refusal

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

    from stepdiag_ros.text.console import PlainConsole

_PICTURE_CHOICES = ("png", "svg", "pdf", "none")


def is_bag(path: Path) -> bool:
    """Say whether a path is a bag by its name; every other file is taken for a table."""
    return path.is_dir() or path.name.endswith((".mcap", ".mcap.zstd"))


def refuse_for_table(source: Path, stated: Mapping[str, object]) -> None:
    """Refuse options that a table has no use for.

    Args:
        source: a bag or a table.
        stated: option → its value; None where the user does not state it.

    Raises:
        Refusal: the source is a table, and one is stated; names both.
    """
    for option, value in stated.items():
        if value is not None and not is_bag(source):
            raise Refusal(
                f"{source}: {option} needs a bag, since a table is one run without temperatures of"
                f" the material. Leave out {option}",
                fault="mismatch",
                about=option,
                where=str(source),
            )


def add_output_options(parser: ArgumentParser, default_folder: str) -> None:
    """Add the options for where and how results are shown.

    Args:
        parser: of the command.
        default_folder: where results go if ``--output`` is not given, in words.
    """
    add_common(parser, "json", help="print JSON in SI units instead of tables")
    add_common(
        parser, "output", help=f"folder for pictures, JSON and text (default: {default_folder})"
    )
    add_common(
        parser,
        "pictures",
        help="format of the pictures, or none (default: png); pdf gives pages for print",
    )


def show(
    name: str,
    document: str,
    show_text: "Callable[[PlainConsole], None]",
    draw: "Callable[[], Mapping[str, Picture]]",
    arguments: Namespace,
    default_folder: Path,
    pictures: Collection[str] = (),
) -> int:
    """Write a result into its folder and print it as the user asked; return the exit code.

    Args:
        name: of the files: ``NAME.json`` and ``NAME.txt``.
        document: the JSON.
        show_text: prints the result to a console.
        draw: returns the pictures by the names of their files; only called if they are wanted.
        arguments: parsed, with the options of ``add_output_options``.
        default_folder: where results go if the user named no folder.
        pictures: names of all pictures of such results, without ending; * for any text. Those of
            earlier results are deleted.
    """
    from stepdiag_ros.report.publish import write_results
    from stepdiag_ros.text.console import make_console

    folder = arguments.output or default_folder
    formats = picture_formats(arguments)
    text = io.StringIO()
    show_text(make_console(text))
    contents = {f"{name}.json": document + "\n", f"{name}.txt": text.getvalue()}
    warn_of_replaced(folder / f"{name}.json", run_of(document))
    earlier = {path.stem for one in pictures for path in folder.glob(f"{one}.*")}
    with progress_bar("writing results") as progress:
        files = write_results(folder, contents, lambda: dict(draw()), formats, progress, earlier)
    if arguments.json:
        print(document)
    else:
        show_text(make_console(sys.stdout))
    say(f"results in {folder}: {', '.join(path.name for path in files)}")
    return 0
