"""Reads plan, machine, cell and instrument files: by path, or by the bare name of one of ours.

Every refusal is one sentence that names the file, and the line or the key where it is wrong. The
text of a file is returned beside what was made from it, because a run records the text.
"""

import hashlib
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import yaml

from stepdiag_ros import resources
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.refusal import Refusal, fields_of
from stepdiag_ros.metrology.spelling import nearest, suggestion
from stepdiag_ros.text.intake import parse_yaml

if TYPE_CHECKING:
    from stepdiag_ros.metrology.cell import SimulatedCell
    from stepdiag_ros.metrology.machine import Machine
    from stepdiag_ros.metrology.model import MachineModel
    from stepdiag_ros.metrology.plausible import Plausible
    from stepdiag_ros.metrology.target import Target
    from stepdiag_ros.metrology.tracker.instrument import Tracker
    from stepdiag_ros.metrology.uncertainty.instrument import Instrument

Folder = Literal[
    "plans", "machines", "cells", "instruments", "trackers", "models", "devices", "imports"
]
Made = TypeVar("Made")

_BARE_NAME = re.compile(r"[A-Za-z0-9_-]+")
_SINGULAR = {
    "plans": "plan",
    "machines": "machine",
    "cells": "cell",
    "instruments": "instrument",
    "trackers": "tracker",
    "models": "model",
    "devices": "device file",
    "imports": "mapping file",
}
_OWN_KEYS: dict[Folder, set[str]] = {
    "plans": {"step_m", "blocks", "lines"},
    "cells": {"errors", "misalignment", "drive"},
    "models": {"curves"},
    "machines": {"travel_low_m", "feed_limit_m_per_s", "position_window_m"},
    "instruments": {"laser", "setup"},
    "trackers": {"held_by", "length_noise_m"},
}
"""Kind of file → keys that no other kind has."""


def available(folder: Folder) -> list[str]:
    """Return the names of the package's files of one kind, in alphabetical order."""
    return sorted(path.stem for path in (resources.directory("config") / folder).glob("*.yaml"))


def find(name_or_path: str | Path, folder: Folder) -> Path:
    """Return the file that a path or a bare name means; a file in the working folder goes first.

    Raises:
        ValueError: there is no such file; names those that come with the package.
    """
    what = _SINGULAR[folder]
    if not str(name_or_path):
        raise ValueError(
            f"no {what} was given: give the path of a YAML file"
            f" or one of {', '.join(available(folder))}"
        )
    path = Path(name_or_path).expanduser()
    if path.is_file():
        return path
    if path.is_dir() and not _BARE_NAME.fullmatch(str(name_or_path)):
        raise Refusal(
            f"{path} is a folder; a YAML file is needed", fault="wrong_kind", aspect="folder"
        )
    if _BARE_NAME.fullmatch(str(name_or_path)):
        packaged = resources.directory("config") / folder / f"{name_or_path}.yaml"
        if packaged.is_file():
            return packaged
    near = nearest(name_or_path, available(folder))
    beside = [str(one) for one in path.parent.glob("*.y*ml")]
    # A path is meant where it has an ending; a name of the package has none.
    near = nearest(path, beside) if path.suffix else near
    hint = f"{suggestion(near)} Give" if near else "give"
    is_path = path.suffix or len(path.parts) > 1
    why = ", because this file does not exist" if is_path else ""
    raise Refusal(
        f"there is no {what} '{name_or_path}'{why}: {hint} the path of a YAML file"
        f" or one of {', '.join(available(folder))}",
        fault="not_found",
    )


def read_text(path: Path) -> str:
    """Return the text of a file.

    Raises:
        ValueError: it is not there, cannot be read or is not text; names the file.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise Refusal(
            f"{path}: not a text file (UTF-8)", fault="wrong_kind", aspect="text"
        ) from None
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None


def read_yaml(path: Path) -> Any:
    """Parse a YAML file.

    Raises:
        ValueError: not readable, not YAML, or a key is there twice; names the file and the line.
    """
    return parse_yaml(read_text(path), str(path))


def _load(
    name_or_path: str | Path, folder: Folder, make: Callable[[str, str], Made]
) -> tuple[Made, str]:
    path = find(name_or_path, folder)
    text = read_text(path)
    try:
        return make(text, str(path)), text
    except Refusal as error:
        other = _seems_to_be(text, folder)
        if not other:
            example = resources.directory("config") / folder / "demo.yaml"
            if error.fault != "missing" or not example.is_file():
                raise
            said = f"{str(error).rstrip('.')}; {example} explains every key"
            raise Refusal(said, **fields_of(error)) from error
        raise Refusal(
            f"{path} has the keys of the kind '{_SINGULAR[other]}'; a file of the kind"
            f" '{_SINGULAR[folder]}' is needed",
            fault="wrong_kind",
            about=_SINGULAR[other],
        ) from error


def _seems_to_be(text: str, folder: Folder) -> Folder | None:
    """Return another kind of file that has the keys of a text; None if there is no such kind."""
    try:
        parsed = parse_yaml(text, "")
    except ValueError:
        return None
    if not isinstance(parsed, Mapping) or _OWN_KEYS.get(folder, set()) & {*parsed}:
        return None
    return next((kind for kind, keys in _OWN_KEYS.items() if keys & {*parsed}), None)


def plan_from_text(text: str, source: str) -> Plan:
    """Make a plan from the text of a plan file.

    Raises:
        ValueError: names the source, the line or key, and what is expected.
    """
    return Plan.from_mapping(parse_yaml(text, source), source)


def machine_from_text(text: str, source: str) -> "Machine":
    """Make a machine from the text of a machine file.

    Raises:
        ValueError: names the source, the line or key, and what is expected.
    """
    from stepdiag_ros.metrology.machine import Machine

    return Machine.from_mapping(parse_yaml(text, source), source)


def machine_if_described(text: str, source: str) -> "Machine | None":
    """Return the machine in the YAML that is recorded with a run; None where it lacks its drives.

    An imported table states a name and perhaps a chain, which is not a fault.
    """
    try:
        return machine_from_text(text, source)
    except ValueError:
        return None


def chain_from_text(text: str, source: str) -> str:
    """Return the order of the axes from workpiece to tool in a machine's YAML; empty if not stated.

    The machine of an imported table holds only what its case file knew, so it may lack all else.

    Raises:
        ValueError: the text is not YAML, or the chain is neither a text nor a list of texts.
    """
    parsed = parse_yaml(text, source) if text else {}
    chain = parsed.get("chain", "") if isinstance(parsed, Mapping) else ""
    letters = list(chain) if isinstance(chain, str | list) else [chain]
    if not all(isinstance(letter, str) for letter in letters):
        raise Refusal(
            f"{source}: 'chain' is {str(chain)[:60]}; expected a text such as YXZ",
            fault="malformed",
        )
    return "".join(letters)


def plausible_from_text(text: str, source: str) -> "Plausible":
    """Return the plausible size of a machine's rotations by its YAML.

    Raises:
        ValueError: it is neither a class of machine nor a size; names the source and the key.
    """
    from stepdiag_ros.metrology.plausible import ORDINARY, ROTATIONS_KEY, Plausible, size_of

    parsed = parse_yaml(text, source) if text else {}
    if not isinstance(parsed, Mapping) or ROTATIONS_KEY not in parsed:
        return ORDINARY
    try:
        return Plausible(rotation=size_of(parsed[ROTATIONS_KEY]))
    except ValueError as error:
        raise ValueError(f"{source}: '{ROTATIONS_KEY}': {error}") from None


def cell_from_text(text: str, source: str) -> "SimulatedCell":
    """Make a simulated cell from the text of a cell file.

    Raises:
        ValueError: names the source, the line or key, and what is expected.
    """
    from stepdiag_ros.metrology.cell import SimulatedCell

    return SimulatedCell.from_mapping(parse_yaml(text, source), source)


def without_effects(cell_text: str, source: str) -> str:
    """Return the part of a simulated cell that a run may reveal: all but the hidden effects.

    A text without effects comes back as it is. Of any other its comments are left out too, since
    they may reveal what is hidden; its SHA-256 says which file it was.

    Args:
        cell_text: of the cell file; empty on a real machine.
        source: what the user calls it; named in errors.

    Raises:
        ValueError: not YAML; names the source and the line.
    """
    parsed = parse_yaml(cell_text, source) if cell_text else None
    if not isinstance(parsed, Mapping) or not parsed.get("effects"):
        return cell_text
    digest = hashlib.sha256(cell_text.encode()).hexdigest()
    told = {key: value for key, value in parsed.items() if key != "effects"}
    return (
        f"# The effects of this cell are not recorded. SHA-256 of the whole file: {digest}\n"
        + yaml.safe_dump(told, sort_keys=False, allow_unicode=True)
    )


def target_from_text(text: str, source: str = "until") -> "Target":
    """Make the target of a run from what a goal, a parameter or a run description has of it.

    Args:
        text: such as ``0.5um`` or ``X:A=1um``, or YAML with the keys ``until`` (such a text) and
            ``conditions`` (those of ``stepdiag iso230 --uncertainty``).
        source: what the user calls the text.

    Raises:
        ValueError: names the source, the key, and what is expected.
    """
    from stepdiag_ros.metrology.checking import Section
    from stepdiag_ros.metrology.standards.positioning_uncertainty import UncertaintyDescription
    from stepdiag_ros.metrology.target import Target

    if "\n" not in text.strip() and not text.lstrip().startswith("{"):
        return Target.from_text(text, source=source)
    section = Section(parse_yaml(text, source), source)
    until = section.text("until")
    told = section.given(("conditions",)).get("conditions", {})
    section.finish()
    conditions = UncertaintyDescription.from_mapping(told, f"{source}: conditions")
    return Target.from_text(until, conditions, source)


def instrument_from_text(text: str, source: str) -> "Instrument":
    """Make the description of an instrument from the text of an instrument file.

    Raises:
        ValueError: names the source, the line or key, and what is expected.
    """
    from stepdiag_ros.metrology.uncertainty.instrument import Instrument

    return Instrument.from_mapping(parse_yaml(text, source), source)


def tracker_from_text(text: str, source: str) -> "Tracker":
    """Make a tracker from the text of a tracker file.

    Raises:
        ValueError: names the source, the line or key, and what is expected.
    """
    from stepdiag_ros.metrology.tracker.instrument import Tracker

    return Tracker.from_mapping(parse_yaml(text, source), source)


def model_from_text(text: str, source: str) -> "MachineModel":
    """Make the model of a machine from the text of a model file.

    Raises:
        ValueError: names the source, the line or key, and what is expected.
    """
    from stepdiag_ros.metrology.effects import catalogue
    from stepdiag_ros.metrology.model import MachineModel

    return MachineModel.from_mapping(parse_yaml(text, source), source, catalogue())


def load_plan(name_or_path: str | Path) -> tuple[Plan, str]:
    """Return a test plan and its text.

    Args:
        name_or_path: path of a YAML file, or a name in ``config/plans`` such as ``demo``.

    Raises:
        ValueError: not found, not readable or wrong; one sentence with file and line or key.
    """
    return _load(name_or_path, "plans", plan_from_text)


def plan_given(given: str) -> tuple[Plan, str]:
    """Return a test plan that is given as a file, a name or the YAML text itself, and its text.

    Args:
        given: taken as the text if it has several lines or begins with a brace, otherwise as
            ``load_plan`` does.

    Raises:
        ValueError: as ``load_plan`` and ``plan_from_text``.
    """
    if "\n" in given.strip() or given.lstrip().startswith("{"):
        return plan_from_text(given, "the given plan"), given
    return load_plan(given.strip())


def load_machine(name_or_path: str | Path) -> "tuple[Machine, str]":
    """Return what is known of a real machine, and the text; see ``load_plan``.

    Raises:
        ValueError: not found, not readable or wrong; one sentence with file and line or key.
    """
    return _load(name_or_path, "machines", machine_from_text)


def load_cell(name_or_path: str | Path) -> "tuple[SimulatedCell, str]":
    """Return a simulated cell (true errors of a simulated run), and the text; see ``load_plan``.

    Raises:
        ValueError: not found, not readable or wrong; one sentence with file and line or key.
    """
    return _load(name_or_path, "cells", cell_from_text)


def load_instrument(name_or_path: str | Path) -> "tuple[Instrument, str]":
    """Return how well an instrument and what is around it are known; see ``load_plan``.

    Raises:
        ValueError: not found, not readable or wrong; one sentence with file and line or key.
    """
    return _load(name_or_path, "instruments", instrument_from_text)


def load_tracker(name_or_path: str | Path) -> "tuple[Tracker, str]":
    """Return an autotracking interferometer and the text; see ``load_plan``.

    Raises:
        ValueError: not found, not readable or wrong; one sentence with file and line or key.
    """
    return _load(name_or_path, "trackers", tracker_from_text)


def load_model(name_or_path: str | Path) -> "tuple[MachineModel, str]":
    """Return the model of a machine, and the text; see ``load_plan``.

    Raises:
        ValueError: not found, not readable or wrong; one sentence with file and line or key.
    """
    return _load(name_or_path, "models", model_from_text)


def load_device(name_or_path: str | Path) -> tuple[dict[str, Any], str]:
    """Return the settings of a device's driver, and the text; see ``load_plan``.

    Args:
        name_or_path: path of a YAML file, or a name in ``config/devices``.

    Raises:
        ValueError: not found, not readable, or no table of settings; names the file.
    """
    return _load(name_or_path, "devices", _settings_from_text)


def _settings_from_text(text: str, source: str) -> dict[str, Any]:
    parsed = parse_yaml(text, source)
    if not isinstance(parsed, dict):
        raise ValueError(f"{source}: a device file is a table of settings, 'name: value' each")
    return parsed
