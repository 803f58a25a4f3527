"""Reads angles and straightness from the text files of Renishaw's laser software.

Files of angles (``.rta``) and straightness (``.rts``) have the sections of a linear test
(``renishaw_rtl``). What is public of them is one program that reads ``.rta``, and it takes the same
numbers once for milliradians and once for another unit. The files name the axis that moved, not the
error: a pitch of X is E_BX or E_AX by how the optics lay. So the user says error, unit and
uncertainty, and whatever the text states (suffix, words of the header and of the equipment, the
axis) must agree with it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.imports import renishaw_rtl
from stepdiag_ros.bags.imports.source import SourceFile
from stepdiag_ros.metrology.direct import DirectCurve, DirectMeasurement, DirectPlace
from stepdiag_ros.metrology.geometry import AXES, ROTATIONS

UNITS: Mapping[str, float] = {
    "urad": 1e-6,
    "mrad": 1e-3,
    "arcsec": math.pi / 648000.0,
    "nm": 1e-9,
    "um": 1e-6,
    "mm": 1e-3,
}
"""Name of a unit of deviations → rad or m."""
OF_ANGLES = ("urad", "mrad", "arcsec")
ANGLE, STRAIGHTNESS, POSITION = "an angle", "a straightness", "a positioning error"
_SUFFIXES = {".rta": ANGLE, ".rts": STRAIGHTNESS, ".rtl": POSITION}
_WORDS = {"angul": ANGLE, "straight": STRAIGHTNESS}
_FEWEST = 3


@dataclass(frozen=True)
class FileFacts:
    """What the user says about a file.

    Attributes:
        curve: ISO 230-1 name of the error.
        unit: of the deviations, one of ``UNITS``.
        uncertainty: standard uncertainty of a deviation but for its repeatability, m or rad.
        place: where it was measured.
        decimal: sign in numbers, ``.`` or ``,``.
        encoding: of the text; empty to find out.
    """

    curve: str
    unit: str
    uncertainty: float
    place: DirectPlace
    decimal: str = "."
    encoding: str = ""


def read_direct_test(source: SourceFile, told: FileFacts) -> DirectMeasurement:
    """Read one error from a file; every run is a repeat, in whichever sense it was measured.

    Raises:
        TableError: the file is cut off or contradicts itself or what the user says; names file and
            row.
    """
    if not renishaw_rtl.recognises(source):
        raise TableError(
            f"{source.name} is not a file of Renishaw's laser software, which begins with"
            " HEADER::; a table of direct measurements needs no conversion (form: 'stepdiag"
            " compare --help')"
        )
    text = source.text(told.encoding)
    content, rows = renishaw_rtl.deviations(text, told.decimal)
    _check(source, told, content)
    scale = UNITS[told.unit] / renishaw_rtl.MICRO
    runs: dict[int, dict[float, float]] = {}
    for row in rows:
        own = runs.setdefault(row.run, {})
        if row.target in own:
            raise TableError(
                f"{source.name}, row {row.row}: target {1e3 * row.target:g} mm appears twice in"
                f" run {row.run}"
            )
        own[row.target] = scale * row.deviation
    positions = sorted({row.target for row in rows})
    for run, own in runs.items():
        missing = [position for position in positions if position not in own]
        if missing:
            raise TableError(
                f"{source.name}: run {run} has no target {1e3 * missing[0]:g} mm; the file may be"
                " cut off"
            )
    if len(positions) < _FEWEST:
        raise TableError(f"{source.name} has {len(positions)} targets; {_FEWEST} are needed")
    curve = DirectCurve(
        name=told.curve,
        positions=np.array(positions),
        values=np.array([[own[position] for position in positions] for own in runs.values()]),
        stated_uncertainty=np.full(len(positions), told.uncertainty),
        place=told.place,
    )
    largest = float(np.max(np.abs(curve.values)))
    if largest > 0.1:
        raise TableError(
            f"{source.name}: a deviation is {largest:.3g} {'rad' if _is_angle(told) else 'm'};"
            f" is {told.unit} the unit?"
        )
    notes = [f"{told.curve} from {source.path.name}, SHA-256 {source.sha256}"]
    for section in ("HEADER", "USER-TEXT", "EQUIPMENT"):
        notes += [f"{key}: {word}" for key, (_, word) in content.entries.get(section, {}).items()]
    return DirectMeasurement({told.curve: curve}, {}, tuple(note for note in notes if note))


def _is_angle(told: FileFacts) -> bool:
    return told.curve in ROTATIONS


def _kind(curve: str) -> str:
    if curve in ROTATIONS:
        return ANGLE
    return POSITION if curve[2] == curve[3] else STRAIGHTNESS


def _check(source: SourceFile, told: FileFacts, content: renishaw_rtl.RtlContent) -> None:
    """Refuse a file whose text contradicts the user."""
    if _is_angle(told) != (told.unit in OF_ANGLES):
        raise TableError(
            f"{told.curve} is {_kind(told.curve)}: {told.unit} is not a unit of it; use"
            f" {', '.join(u for u in UNITS if (u in OF_ANGLES) == _is_angle(told))}"
        )
    kinds = {_SUFFIXES.get(source.path.suffix.lower(), "")}
    for section, keys in (("HEADER", ("File type",)), ("TARGET DATA", ("Filetype",))):
        for key in keys:
            kinds |= _kinds_in(content.entry(section, key)[1])
    for key, (_, words) in content.entries.get("EQUIPMENT", {}).items():
        kinds |= _kinds_in(f"{key} {words}")
    wrong = sorted(kinds - {"", _kind(told.curve)})
    if wrong:
        raise TableError(
            f"{source.name} holds {wrong[0]}, by its name or its text, and {told.curve} is"
            f" {_kind(told.curve)}"
        )
    axis = content.entry("USER-TEXT", "Axis")[1]
    letters = {letter for letter in AXES if letter in axis.upper().replace("AXIS", "")}
    if len(letters) == 1 and told.curve[3] not in letters:
        raise TableError(
            f"{source.name}: the axis is '{axis}', and {told.curve} is an error of {told.curve[3]}"
        )


def _kinds_in(words: str) -> set[str]:
    return {kind for word, kind in _WORDS.items() if word in words.lower()}
