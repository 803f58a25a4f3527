"""Tests of positioning in words: what they found, and to how many places figures are written."""

import math
from collections.abc import Iterable, Sequence

from stepdiag_ros.evaluation.positioning import PositioningReport
from stepdiag_ros.metrology.geometry import LINEAR_LINES
from stepdiag_ros.metrology.standards.axis_test import is_diagonal
from stepdiag_ros.metrology.standards.iso230_2 import PARAMETERS, PositioningTest
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.text.numbers import UNKNOWN, plain, with_uncertainty

_LEADING = ("A", "R", "E", "M", "B")
_DIGITS = 4
"""Significant digits of the largest parameter where no uncertainty says how many there are."""


def decimals_of(tests: Sequence[PositioningTest]) -> int:
    """Return the decimals, in µm, that show the largest parameter of some tests to four digits."""
    values = [abs(value) for test in tests for value in test.parameters.values()]
    largest = max((value for value in values if math.isfinite(value)), default=0.0) * IN_MICRO
    if largest == 0:
        return 2
    return min(max(_DIGITS - 1 - math.floor(math.log10(largest)), 1), 6)


def written(value: float, uncertainty: float, decimals: int) -> str:
    """Write a value with its expanded uncertainty (both m) in µm, or to decimals without one."""
    if not math.isfinite(value):
        return UNKNOWN
    if not math.isfinite(uncertainty):
        return f"{plain(value * IN_MICRO, decimals)} ± {UNKNOWN}"
    value_text, uncertainty_text = with_uncertainty(value * IN_MICRO, uncertainty * IN_MICRO)
    return f"{value_text} ± {uncertainty_text}"


def head_of(uncertainties: Iterable[float]) -> str:
    """Return the head of a column of values; it says once what would else stand in each row."""
    known = any(math.isfinite(one) for one in uncertainties)
    return "value ± U / µm" if known else f"value / µm, U {UNKNOWN}"


def cell_below(value: float, uncertainty: float, decimals: int, head: str) -> str:
    """Write a value (m) in µm as the head of its column says; see ``head_of``."""
    if UNKNOWN in head:
        return plain(value * IN_MICRO, decimals)
    return written(value, uncertainty, decimals)


def size_words(value: float, uncertainty: float, decimals: int) -> str:
    """Write a value with its expanded uncertainty (both m) and the unit, as it stands alone."""
    if math.isfinite(value) and not math.isfinite(uncertainty):
        return f"{plain(value * IN_MICRO, decimals)} µm (U {UNKNOWN})"
    return f"{written(value, uncertainty, decimals)} µm"


def leading_parameters(test: PositioningTest) -> tuple[str, ...]:
    """Return the parameters that stand for a test: A, R, E, M, B, or what is known without them."""
    bidirectional = tuple(name for name in _LEADING if math.isfinite(test.parameters[name]))
    known = tuple(name for name in PARAMETERS if math.isfinite(test.parameters[name]))
    return bidirectional or known


def leading_sentences(report: PositioningReport) -> list[str]:
    """Return the parameters of every test with U, and why a U is unknown, in sentences."""
    decimals = decimals_of(report.tests)
    said, known = [], []
    for test in report.tests:
        names = leading_parameters(test)
        with_u = [name for name in names if math.isfinite(test.expanded_uncertainty[name])]
        known += with_u
        figures = ", ".join(
            f"{name} = {written(test.parameters[name], test.expanded_uncertainty[name], decimals)}"
            " µm"
            if with_u
            else f"{name} = {plain(test.parameters[name] * IN_MICRO, decimals)} µm"
            for name in names
        )
        forward, backward = test.runs
        said.append(
            f"{test.standard}, {subject_of(test)}, {forward} runs forward and {backward} backward:"
            f" {figures}{'' if with_u else f' (U {UNKNOWN})'}."
        )
    if known:
        said.append("U: expanded uncertainty, k = 2, of the conditions that --uncertainty states.")
    if report.unknown:
        which = "A U is unknown where it needs" if known else "U is unknown, because it needs"
        said.append(
            f"{which} what is not stated: {', '.join(report.unknown)} (stepdiag iso230"
            " or stepdiag report, --uncertainty FILE)."
        )
    return said


def uneven_reason(lines: Sequence[str]) -> str:
    """Return why lines with unevenly spaced targets have no error curves, in a sentence."""
    names = [line.upper() if line in LINEAR_LINES else line for line in lines]
    return f"The targets of {', '.join(names)} are not evenly spaced."


def subject_of(test: PositioningTest) -> str:
    """Name the axis or the diagonal of a test."""
    what = "diagonal" if is_diagonal(test.kind) else "axis"
    return f"{what} {test.name}"


def sentences(report: PositioningReport) -> list[str]:
    """Return what the reader must know, in words."""
    said = [
        "Deviations are measured less commanded positions; ↑ forward, ↓ backward."
        " U: expanded uncertainty of measurement, k = 2 (ISO 230-2 annex A, ISO/TR 230-9)."
    ]
    if report.unknown:
        said.append(
            f"U is unknown where it needs what is not known: {', '.join(report.unknown)}"
            " (name them in a file: --uncertainty)."
        )
    if report.published is not None:
        differing = [
            f"{name} (published {plain(report.published.values[name] * IN_MICRO, decimals)} µm, by"
            f" the standard {plain(test.parameters[name] * IN_MICRO, decimals)} µm)"
            for test in report.tests
            for decimals in (decimals_of([test]),)
            for name in PARAMETERS
            if name in report.published.values
            and not report.published.agrees(name, test.parameters[name])
        ]
        if differing:
            said.append(f"Published figures that depart from ISO 230-2: {'; '.join(differing)}.")
    for test in report.tests:
        said.extend(f"{test.label}: {remark}." for remark in test.remarks)
    for group in report.groups:
        said.extend(f"{remark}." for remark in group.remarks)
    said.extend(report.warnings)
    return said
