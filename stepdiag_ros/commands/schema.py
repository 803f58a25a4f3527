"""``stepdiag schema``: what is in the JSON that other commands print, and in messages."""

import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from pathlib import Path

from stepdiag_ros import resources, schemas
from stepdiag_ros.commands.arguments import Command, Group, no_such
from stepdiag_ros.metrology.spelling import nearest

_EXAMPLES = """\
examples:
  stepdiag schema                                  lists the documents and messages
  stepdiag schema diagnosis > diagnosis.schema.json
  stepdiag schema result > result.schema.json       for a validator, or to generate code from
  stepdiag schema RunVerdict                       the fields of a message"""


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument(
        "name",
        nargs="?",
        type=_known,
        metavar="NAME",
        help=f"one of {', '.join(schemas.VERSIONS)}, or a message such as RunVerdict",
    )


def run(arguments: Namespace) -> int:
    """Print a schema, or the list of them; see the module."""
    interfaces = _interfaces()
    if arguments.name in interfaces:
        sys.stdout.write(interfaces[arguments.name].read_text(encoding="utf-8"))
    elif arguments.name is not None:
        sys.stdout.write(schemas.schema_text(arguments.name))
    else:
        for name in schemas.VERSIONS:
            print(f"{name:18}{schemas.schema(name)['title']}")
        print(f"messages and the action: {', '.join(interfaces)}")
    return 0


def _known(name: str) -> str:
    # Looked up only here: other commands start without it.
    from stepdiag_ros.topics import TOPICS

    known = [*schemas.VERSIONS, *_interfaces()]
    if name in known:
        return name
    topics = {topic.name: topic.type_name.rpartition("/")[2] for topic in TOPICS}
    if topics.get(name) in known:
        raise ArgumentTypeError(f"'{name}' is a topic; its type is: stepdiag schema {topics[name]}")
    if nearest(name, known):
        raise ArgumentTypeError(no_such(name, known))
    raise ArgumentTypeError(f"there is no '{name}'; list the names with: stepdiag schema")


def _interfaces() -> dict[str, Path]:
    """Return the definitions of the messages and the action by their names."""
    files = (*resources.directory("msg").glob("*.msg"), *resources.directory("action").iterdir())
    return {path.stem: path for path in sorted(files) if path.suffix in (".msg", ".action")}


COMMAND = Command(
    "schema",
    Group.EXCHANGE,
    40,
    _add_options,
    run,
    help="print the schema of a JSON document, or the fields of a message",
    description="Print the JSON Schema (2020-12) of the document that another command prints with"
    " --json. The field 'schema' of the document names its schema. For the name of a message or of"
    " the action, print its definition.",
    epilog=_EXAMPLES,
)
