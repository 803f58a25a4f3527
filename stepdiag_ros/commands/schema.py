"""``stepdiag schema``: what is in the JSON that other commands print."""

import sys
from argparse import ArgumentParser, Namespace, _SubParsersAction

from stepdiag_ros import schemas
from stepdiag_ros.commands.output import HelpFormatter

_EXAMPLES = """\
examples:
  stepdiag schema                                  lists the documents
  stepdiag schema diagnosis > diagnosis.schema.json
  stepdiag schema result > result.schema.json       for a validator, or to generate code from"""


def add_parser(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "schema",
        help="print the schema of a JSON document: every field with meaning and unit",
        description="Print the JSON Schema (2020-12) of a document that another command prints"
        " with --json. The document names its schema in its field 'schema'.",
        epilog=_EXAMPLES,
        formatter_class=HelpFormatter,
    )
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help=f"one of {', '.join(schemas.VERSIONS)}"
    )
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Print a schema, or the list of them; see the module."""
    if arguments.name is not None:
        sys.stdout.write(schemas.schema_text(arguments.name))
        return 0
    for name in schemas.VERSIONS:
        print(f"{name:18}{schemas.schema(name)['title']}")
    return 0
