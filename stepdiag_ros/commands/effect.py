"""``stepdiag effect``: lists the effects, and makes a package for one that somebody names."""

from argparse import ArgumentParser, Namespace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from stepdiag_ros.commands.arguments import Command, Group, add_common
from stepdiag_ros.commands.output import say

if TYPE_CHECKING:
    from stepdiag_ros.metrology.model import MachineModel

_OWN = "stepdiag_ros.metrology.effects"
_EXAMPLES = """\
examples:
  stepdiag effect list                                 what the diagnosis tries
  stepdiag diagnose run.mcap --extend mill.yaml        DESCRIBED: the model learns a formula
  stepdiag effect new quadrant-bend --model mill.yaml  the formula as a package of its own
  pytest quadrant_bend                                 its test
  pip install ./quadrant_bend                          now the diagnosis tries it on every run

The package holds the module, its test and pyproject.toml. State 'sentence' and
'source' in the module before you install it: the diagnosis refuses an effect
without them."""


def _add_options(parser: ArgumentParser) -> None:
    what = parser.add_subparsers(title="subcommand", metavar="WHAT", dest="what", required=True)
    new = what.add_parser(
        "new",
        help="write a package for an effect: module, test and pyproject.toml",
        description="Write a package for an effect of your own: a module with the formula that a"
        " model has learned, or with an example, its test, and the pyproject.toml by which the"
        " diagnosis finds it once the package is installed. No file is overwritten.",
        epilog=_EXAMPLES,
    )
    new.add_argument("name", help="of the effect, in small letters, such as quadrant-bend")
    new.add_argument(
        "--model",
        metavar="MODEL",
        help="model (YAML) with the learned shapes, by path or name (default: an example)",
    )
    add_common(new, "output", help="folder of the package (default: the name, in this folder)")
    new.set_defaults(run=run)
    what.add_parser(
        "list",
        help="list the effects that the diagnosis tries, installed ones included",
        description="List the effects that the diagnosis tries, those of installed packages"
        " included, with the keys of their settings and their modules.",
    ).set_defaults(run=_list)


def _list(_: Namespace) -> int:
    """Print the catalogue."""
    import sys

    from stepdiag_ros.metrology.effects import catalogue
    from stepdiag_ros.text.console import make_console
    from stepdiag_ros.text.table import Column, Table

    headers = ("effect", "setting", "module")
    table = Table("Effects", [Column(one, number=False, wraps=True) for one in headers])
    for name, effect in catalogue().items():
        keys = ", ".join(key.name for key in effect.keys)
        module = type(effect).__module__
        table.add_row(name, keys, module.removeprefix(f"{_OWN}."))
    make_console(sys.stdout).print(table)
    return 0


def run(arguments: Namespace) -> int:
    """Write the package; see the module.

    Raises:
        ValueError: the name cannot be one, the model holds no learned shape, or a file is there.
    """
    from stepdiag_ros.metrology.effects import catalogue
    from stepdiag_ros.report.effect_package import checked_name, package_of
    from stepdiag_ros.report.files import make_folder, whole_file

    known = catalogue()
    module = checked_name(arguments.name, known)
    model = None if arguments.model is None else _model(arguments.model)
    files = package_of(arguments.name, known, model, str(arguments.model))
    folder = arguments.output or Path(module)
    if there := [name for name in files if (folder / name).exists()]:
        raise ValueError(
            f"{folder / there[0]} is there already and is not overwritten: name another --output"
        )
    make_folder(folder)
    for name, text in files.items():
        with whole_file(folder / name) as partial:
            partial.write_text(text, encoding="utf-8")
    # pip takes a name without a slash as that of a package in its index.
    place = quote(str(folder) if folder.is_absolute() else f"./{folder}")
    say(
        f"effect in {folder}: {', '.join(files)}; state 'sentence' and 'source' in {module}.py, run"
        f" 'python -m pytest {place}' (pytest must be installed), then 'pip install {place}'"
    )
    return 0


def _model(name: str) -> "MachineModel":
    """Load a model; a refusal also says when the diagnosis writes one."""
    from stepdiag_ros.configuration import load_model
    from stepdiag_ros.metrology.refusal import Refusal, fields_of

    try:
        return load_model(name)[0]
    except Refusal as error:
        if error.fault != "not_found":
            raise
        raise Refusal(
            f"{error}. 'stepdiag diagnose --extend' writes a model only if its verdict is NAMED or"
            " DESCRIBED",
            **fields_of(error),
        ) from error


COMMAND = Command(
    "effect",
    Group.UNDERSTAND,
    25,
    _add_options,
    None,
    help="list the effects, or write a package for one of your own",
    description="List the effects that the diagnosis tries, or name one that it has described.",
    epilog=_EXAMPLES,
)
