"""``stepdiag export``: tables from a bag."""

from argparse import ArgumentParser, Namespace

from stepdiag_ros import schemas
from stepdiag_ros.commands.arguments import Command, Group, add_bag, add_common, results_folder
from stepdiag_ros.commands.output import progress_bar, say
from stepdiag_ros.text.intake import refusals_of


def _add_options(parser: ArgumentParser) -> None:
    add_bag(parser)
    add_common(parser, "run")
    add_common(parser, "output", help="default: NAME_tables beside the bag")
    parser.add_argument(
        "--format",
        choices=("csv", "parquet"),
        default="csv",
        help="format of the tables (default: csv)",
    )
    parser.add_argument(
        "--readings", action="store_true", help="write every reading of the interferometer, too"
    )
    parser.add_argument(
        "--attachments",
        action="store_true",
        help="write the files in the bag, too: plan, machine, source of an import",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace existing files")
    add_common(parser, "json", help="print the names of the files as JSON")


def run(arguments: Namespace) -> int:
    """Export the bag; see the module."""
    from stepdiag_ros.bags.attachments import write_attachments
    from stepdiag_ros.bags.export import export_bag

    folder = arguments.output or results_folder(arguments.bag, "tables")
    with progress_bar(f"exporting {arguments.bag.name}"), refusals_of(arguments.bag):
        report = export_bag(
            arguments.bag,
            folder,
            arguments.format,
            readings=arguments.readings,
            overwrite=arguments.overwrite,
            run_id=arguments.run_id,
        )
        files = list(report.files)
        if arguments.attachments:
            files += write_attachments(
                arguments.bag, folder / "attachments", overwrite=arguments.overwrite
            )
    if arguments.json:
        from stepdiag_ros.schemas.export import Document

        document = Document(
            bag=str(arguments.bag),
            files=[str(path) for path in files],
            remarks=report.remarks,
        )
        print(schemas.json_text(schemas.document("export", document)))
    else:
        for path in files:
            print(path)
    for remark in report.remarks:
        say(remark)
    return 0


COMMAND = Command(
    "export",
    Group.EXCHANGE,
    30,
    _add_options,
    run,
    help="write the tables of a bag (CSV or Parquet)",
    description="Write what a bag holds as tables for other programs, in SI units with all"
    " digits: the run table, which 'stepdiag import' reads again, the stops, blocks and lines"
    " with their uncertainties, the recorded results, and the diagnoses beside the run. Unknown"
    " numbers are empty cells.",
    epilog="examples:\n"
    "  stepdiag export run.mcap             writes into run_tables/\n"
    "  stepdiag export run.mcap --readings  every reading of the interferometer, too\n"
    "  stepdiag export run.mcap --attachments  and the files that it was made from",
)
