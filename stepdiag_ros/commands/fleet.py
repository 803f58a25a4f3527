"""``stepdiag fleet``: the machines of an archive on one page, worst first."""

from argparse import ArgumentParser, Namespace
from datetime import datetime, timezone
from functools import partial
from pathlib import Path

from stepdiag_ros.archive import require_libraries
from stepdiag_ros.commands.arguments import Command, Group, add_common, whole
from stepdiag_ros.commands.output import progress_bar, say

_MOST_DAYS = 36_500


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument("place", metavar="PLACE", help="the archive: a folder, or a URL")
    parser.add_argument(
        "--every",
        type=partial(whole, low=1, high=_MOST_DAYS),
        metavar="DAYS",
        help="interval between the runs of a machine; the page then shows what is overdue",
    )
    add_common(parser, "json")
    add_common(
        parser,
        "output",
        metavar="FILE",
        help="the page, .html, in place of an earlier one (default: fleet.html, without --json)",
    )


def run(arguments: Namespace) -> int:
    """Read the catalogue and write the page; see the module."""
    require_libraries()
    from stepdiag_ros.archive.catalogue import Catalogue
    from stepdiag_ros.archive.fleet import fleet
    from stepdiag_ros.archive.place import Place
    from stepdiag_ros.report.documents.fleet import fleet_json
    from stepdiag_ros.report.files import refuse_foreign, write_new
    from stepdiag_ros.report.pages.fleet import FLEET_PAGE, fleet_page
    from stepdiag_ros.words.fleet import headline

    output = arguments.output or (None if arguments.json else Path("fleet.html"))
    if output is not None and output.suffix != ".html":
        raise ValueError(f"{output} is not a page: name a file that ends in .html")
    if output is not None:
        refuse_foreign(output, FLEET_PAGE, "page of 'stepdiag fleet'")
    place, made = Place(arguments.place), datetime.now(timezone.utc)
    with Catalogue(place) as catalogue, progress_bar("reading") as progress:
        machines = fleet(catalogue, progress)
    if output is not None:
        page = fleet_page(place, machines, arguments.every, made, output)
        write_new({output: page.encode()}, overwrite=True)
        say(f"page in {output}")
    if arguments.json:
        print(fleet_json(place.url, machines, arguments.every, made))
    else:
        print(headline(machines))
    return 0


COMMAND = Command(
    "fleet",
    Group.UNDERSTAND,
    86,
    _add_options,
    run,
    help="the machines of an archive on one page, worst first",
    description="Read the catalogue of an archive and write one HTML file with all machines: newest"
    " run against tolerance (ISO 14253-1), largest error over the runs, when it leaves its"
    " tolerance, what has changed since your last visit, and what is overdue.",
    epilog="examples:\n"
    "  stepdiag fleet /data/machines --every 90                  writes fleet.html\n"
    "  stepdiag fleet /data/machines --output /srv/www/fleet.html",
)
