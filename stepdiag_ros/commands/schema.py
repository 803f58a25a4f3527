"""``stepdiag schema``: what is in the JSON that other commands print."""

import sys
from argparse import ArgumentParser, Namespace

from stepdiag_ros import schemas
from stepdiag_ros.commands.arguments import Command, Group

_EXAMPLES = """\
examples:
  stepdiag schema                                  lists the documents
  stepdiag schema diagnosis > diagnosis.schema.json
  stepdiag schema result > result.schema.json       for a validator, or to generate code from"""


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help=f"one of {', '.join(schemas.VERSIONS)}"
    )


def run(arguments: Namespace) -> int:
    """Print a schema, or the list of them; see the module."""
    if arguments.name is not None:
        sys.stdout.write(schemas.schema_text(arguments.name))
        return 0
    for name in schemas.VERSIONS:
        print(f"{name:18}{schemas.schema(name)['title']}")
    return 0


COMMAND = Command(
    "schema",
    Group.EXCHANGE,
    40,
    _add_options,
    run,
    help="print the schema of a JSON document",
    description="Print the JSON Schema (2020-12) of the document that another command prints with"
    " --json. The field 'schema' of the document names its schema.",
    epilog=_EXAMPLES,
)
