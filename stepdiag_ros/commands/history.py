"""``stepdiag history``: what becomes of the machines of an archive over the years."""

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from stepdiag_ros.archive import require_libraries
from stepdiag_ros.commands.arguments import Command, Group, add_common
from stepdiag_ros.commands.output import say


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument("place", metavar="PLACE", help="the archive: a folder, or a URL")
    parser.add_argument(
        "machine",
        nargs="?",
        default="",
        metavar="MACHINE",
        help="name in the archive (default: one row for each machine, worst first)",
    )
    parser.add_argument("--all", action="store_true", help="print more than fits on a screen")
    add_common(parser, "json")
    parser.add_argument(
        "--picture",
        type=Path,
        metavar="FILE",
        help="draw the figures of MACHINE over the years: png, svg or pdf",
    )
    add_common(parser, "force")


def run(arguments: Namespace) -> int:
    """Read the catalogue and show what the years say; see the module."""
    require_libraries()
    from stepdiag_ros import plots, schemas
    from stepdiag_ros.archive.catalogue import Catalogue
    from stepdiag_ros.archive.histories import histories, machine_urgency
    from stepdiag_ros.archive.place import Place
    from stepdiag_ros.plots.formats import format_of
    from stepdiag_ros.report.documents.trends import trends_document
    from stepdiag_ros.report.files import check_new, write_new
    from stepdiag_ros.report.tables.trends import print_machine, print_machines
    from stepdiag_ros.text.console import make_console

    if arguments.picture is not None:
        if not arguments.machine:
            raise ValueError("--picture draws one machine: name it after PLACE")
        picture_format = format_of(arguments.picture)
        check_new([arguments.picture], arguments.force)
    place = Place(arguments.place)
    with Catalogue(place) as catalogue:
        machines = sorted(histories(catalogue, arguments.machine), key=machine_urgency)
    if not machines:
        raise ValueError(
            f"{place.url} has no run with a date and a figure: 'stepdiag archive list {place.url}'"
            " shows what it has"
        )
    if arguments.picture is not None:
        from stepdiag_ros.plots.saving import file_bytes

        content = file_bytes(plots.years_of_machine(machines[0]), picture_format)
        write_new({arguments.picture: content}, arguments.force)
        say(f"picture in {arguments.picture}")
    if arguments.json:
        print(schemas.json_text(trends_document(place.url, machines)))
    elif arguments.machine:
        print_machine(machines[0], make_console(sys.stdout), arguments.all)
    else:
        print_machines(machines, make_console(sys.stdout), arguments.all)
    return 0


COMMAND = Command(
    "history",
    Group.UNDERSTAND,
    85,
    _add_options,
    run,
    help="what changes over the years, by how much a year, and until when it is in tolerance",
    description="Read the catalogue of an archive and show for each machine its figures now, their"
    " trend a year, their changes with dates, and when each leaves its tolerance, all with"
    " uncertainty. Temperature, season and instruments are fitted with them. Tolerances are stated"
    " in archive.yaml.",
    epilog="examples:\n"
    "  stepdiag history /data/machines                          machines, worst first\n"
    '  stepdiag history /data/machines "VMC 3" --picture vmc3.png  one machine, and its picture',
)
