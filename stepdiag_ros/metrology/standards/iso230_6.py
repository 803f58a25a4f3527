"""Positioning along body and face diagonals: ISO 230-6 (and ASME B5.54, which evaluates alike).

Each diagonal is evaluated alone, from five bidirectional runs (RL, "Data analysis"):

    E = max(x̄_i↑; x̄_i↓) - min(x̄_i↑; x̄_i↓), bidirectional systematic deviation of positioning
    B = max |x̄_i↑ - x̄_i↓|, reversal value

and the machine by the worst: over the four body diagonals E_d = max(E_1 … E_4), B_d = max(B_1 …
B_4); over the two diagonals of each face E_d(XY) = max(E_1(XY), E_2(XY)), and so on.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, BODY_DIAGONALS, FACE_DIAGONALS, LINEAR_LINES
from stepdiag_ros.metrology.plan import LINEAR
from stepdiag_ros.metrology.standards.axis_test import is_diagonal
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest

BODY = "body diagonals"
DIAGONALS_ALONE = (
    "diagonal tests alone do not give the volumetric accuracy: errors of different axes can cancel"
    " along the diagonals (ASME B5.54-2005, 7.7: combine them with linear displacement tests"
    " parallel to the axes)"
)


@dataclass(frozen=True)
class DiagonalGroup:
    """The diagonals that one E_d and B_d are made of.

    Attributes:
        place: ``BODY``, or the face: ``face diagonals XY``, ``… XZ``, ``… YZ``.
        labels: D1 … D4 or F1, F2, one for each test; two tests of one diagonal share it.
        tests: in the order of the labels.
        systematic_deviation: E_d, m; NaN while a diagonal of the group is missing.
        reversal_value: B_d, m; NaN while one is missing or was not run in both directions.
        systematic_uncertainty: U(E_d) for k = 2 of the worst diagonal, m; NaN if not known.
        reversal_uncertainty: U(B_d), m.
        remarks: what is missing, in words.
    """

    place: str
    labels: tuple[str, ...]
    tests: tuple[PositioningTest, ...]
    systematic_deviation: float
    reversal_value: float
    systematic_uncertainty: float
    reversal_uncertainty: float
    remarks: tuple[str, ...] = ()


def place_of(diagonal: str) -> str:
    """Return the group that a diagonal belongs to.

    Raises:
        ValueError: no body or face diagonal of that name.
    """
    if diagonal in BODY_DIAGONALS:
        return BODY
    if diagonal in FACE_DIAGONALS:
        plane = "".join(a for a, sign in zip(AXES, diagonal, strict=True) if sign != "0")
        return f"face diagonals {plane}"
    raise ValueError(
        f"'{diagonal}' is not a diagonal; use {', '.join(BODY_DIAGONALS)} or a face diagonal"
    )


def diagonal_groups(tests: Sequence[PositioningTest]) -> tuple[DiagonalGroup, ...]:
    """Return E_d and B_d of the machine, from its body diagonals and from each face.

    Args:
        tests: of diagonals; tests of axes among them are passed over.
    """
    members: dict[str, list[str]] = {}
    for diagonal in (*BODY_DIAGONALS, *FACE_DIAGONALS):
        members.setdefault(place_of(diagonal), []).append(diagonal)
    made = []
    for place, diagonals in members.items():
        letter = "D" if place == BODY else "F"
        chosen = [
            (f"{letter}{number}", test)
            for number, diagonal in enumerate(diagonals, start=1)
            for test in tests
            if test.name == diagonal and is_diagonal(test.kind)
        ]
        if chosen:
            missing = [d for d in diagonals if all(test.name != d for _, test in chosen)]
            made.append(_group(place, chosen, missing))
    return tuple(made)


def _group(
    place: str, chosen: Sequence[tuple[str, PositioningTest]], missing: Sequence[str]
) -> DiagonalGroup:
    tests = tuple(test for _, test in chosen)
    found = {}
    remarks = []
    for name in ("E", "B"):
        values = np.array([test.parameters[name] for test in tests])
        known = bool(np.all(np.isfinite(values))) and not missing
        worst = tests[int(np.argmax(values))] if known else None
        found[name] = (
            (worst.parameters[name], worst.expanded_uncertainty[name])
            if worst is not None
            else (float("nan"), float("nan"))
        )
    if missing:
        remarks.append(f"{place}: {', '.join(missing)} not measured, so E_d and B_d are unknown")
    return DiagonalGroup(
        place=place,
        labels=tuple(label for label, _ in chosen),
        tests=tests,
        systematic_deviation=found["E"][0],
        reversal_value=found["B"][0],
        systematic_uncertainty=found["E"][1],
        reversal_uncertainty=found["B"][1],
        remarks=tuple(remarks),
    )


def volumetric_warning(tests: Sequence[PositioningTest]) -> str:
    """Return the warning of every diagonal report, with the linear tests that are still to be done.

    Args:
        tests: all tests of the run.
    """
    done = [test.name for test in tests if test.kind == LINEAR]
    missing = [letter for letter in AXES if letter not in done]
    if not missing:
        return (
            f"Warning: {DIAGONALS_ALONE}. The linear tests along X, Y and Z are in this run: judge"
            " the machine by both, or by the map of all errors ('stepdiag solve')."
        )
    lines = ", ".join(LINEAR_LINES[AXES.index(letter)] for letter in missing)
    return (
        f"Warning: {DIAGONALS_ALONE}. Missing here: linear positioning of {', '.join(missing)}"
        f" (ISO 230-2, lines {lines}); B5.54-2005 appendix A3 asks for circular tests in three"
        " planes and a cutting test, too."
    )
