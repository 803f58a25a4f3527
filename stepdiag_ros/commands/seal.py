"""``stepdiag seal``: a detached signature of a recording."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from stepdiag_ros import schemas
from stepdiag_ros.commands.arguments import Command, Group, add_common
from stepdiag_ros.commands.output import progress_bar, say


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument("bag", type=Path, nargs="?", help="the recording (.mcap)")
    parser.add_argument("--key", type=Path, metavar="FILE", help="private key to sign with")
    parser.add_argument(
        "--words", default="", metavar="TEXT", help="who signs, and why; signed as well"
    )
    parser.add_argument(
        "--new-key", type=Path, metavar="FILE", help="make a private key, and FILE.pub beside it"
    )
    add_common(parser, "json", help="print the seal as JSON")


def run(arguments: Namespace) -> int:
    """Make a key, seal a file, or check its seal; see the module."""
    from stepdiag_ros.bags.seal import new_key, read_seal, seal, seal_path
    from stepdiag_ros.schemas.seal_check import Document

    if arguments.new_key is not None:
        if arguments.bag is not None or arguments.key is not None:
            raise ValueError("--new-key makes a key and seals nothing: give nothing else with it")
        public = new_key(arguments.new_key)
        say(
            f"{arguments.new_key} is the private key: everyone who has it can seal. Give to"
            f" others only {public}."
        )
        return 0
    if arguments.bag is None:
        raise ValueError("give the recording to seal, or --new-key FILE")
    if arguments.key is not None:
        with progress_bar(f"sealing {arguments.bag.name}"):
            seal(arguments.bag, arguments.key, arguments.words)
    found = read_seal(arguments.bag)
    if found is None:
        there = "" if arguments.bag.exists() else "; there is no such file"
        raise ValueError(f"{arguments.bag} has no seal ({seal_path(arguments.bag).name}){there}")
    if arguments.json:
        print(schemas.json_text(schemas.document("seal_check", Document(**found.as_dict()))))
    elif found.right:
        print(f"{seal_path(arguments.bag)}: {found.text}")
    if not found.right:
        raise ValueError(f"the seal of {arguments.bag} is wrong: {found.problem}")
    return 0


COMMAND = Command(
    "seal",
    Group.LOOK_AFTER,
    30,
    _add_options,
    run,
    help="sign a recording, or check its signature",
    description="Sign a recording (Ed25519), so that everyone with the public key can verify that"
    " it has not changed since. The command writes RUN.mcap.sig beside the recording."
    " 'stepdiag info' and 'stepdiag report' show whether there is a valid seal, and 'stepdiag"
    " compensate --require-seal' refuses a recording without one. Without --key, the command"
    " checks the existing seal.",
    epilog="examples:\n"
    "  stepdiag seal --new-key cell.key            makes cell.key (keep it) and cell.key.pub\n"
    '  stepdiag seal run.mcap --key cell.key --words "A. Dent, acceptance"\n'
    "  stepdiag seal run.mcap                      is the seal right, and by which key?",
)
