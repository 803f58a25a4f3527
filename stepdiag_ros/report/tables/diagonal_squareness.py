"""Squareness from diagonals as a person and a program read it: tables, JSON, the graph of RL."""

import math
from typing import Any

import numpy as np

from stepdiag_ros.evaluation.squareness import SquarenessReport
from stepdiag_ros.metrology.forward import AXES_OF
from stepdiag_ros.metrology.standards.diagonal_squareness import (
    SHIFTS_OF_RL,
    SquarenessResult,
    squareness_error_of_shift,
)
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import ARC_SECONDS, plain, plus_minus
from stepdiag_ros.text.table import new_table
from stepdiag_ros.words.squareness import SIGN_DEFINITIONS, sign

_RATIOS = (1.0, 1.5, 2.0, 3.0, 5.0)
_THETA = "positive where the angle is smaller than 90° (RL: D0 (D1 - D2) / (2XY))"
_SLOPES = (
    "Straight lines through the end points of the axes' motions; least-squares lines of curved axes"
    " give other values."
)


def print_squareness(report: SquarenessReport, console: PlainConsole) -> None:
    """Print the values in both sign definitions, the check that is left over, and the graph."""
    result = report.result
    console.sentence(f"Source: {report.source}")
    console.print()
    table = new_table("Squareness from diagonals", "", "from", "unit", *SIGN_DEFINITIONS, "θ of RL")
    table.columns[1].number = False
    for one in result.values:
        reference, other = AXES_OF[one.name]
        for unit, scale in (("µm/m", IN_MICRO), ("arcsec", ARC_SECONDS)):
            first = unit == "µm/m"
            table.add_row(
                f"{one.name}  {other} to {reference}" if first else "",
                ", ".join(one.diagonals) if first else "",
                unit,
                *(
                    plus_minus(
                        sign(one.name, definition) * one.value, one.standard_uncertainty, scale
                    )
                    for definition in SIGN_DEFINITIONS
                ),
                plus_minus(one.theta, one.standard_uncertainty, scale),
            )
    console.print(table)
    console.print()
    if math.isfinite(result.mean_length_error):
        check = new_table("Body diagonals: the check that is left over", "", "unit", "value ± U")
        check.add_row(
            "mean length error",
            "µm",
            plus_minus(result.mean_length_error, result.mean_length_uncertainty, IN_MICRO),
        )
        check.add_row(
            "the same minus that of the linear tests",
            "µm",
            plus_minus(result.closure, result.closure_uncertainty, IN_MICRO),
        )
        console.print(check)
        console.print()
    console.print(sensitivity_table())
    console.print()
    for definition, words in SIGN_DEFINITIONS.items():
        console.sentence(f"{definition}: {words}.")
    console.sentence(f"θ of RL: {_THETA}.")
    console.sentence(f"{_SLOPES} ±: {COVERAGE_FACTOR:g} standard uncertainties (95 %).")
    if math.isfinite(result.closure):
        console.sentence(closure_sentence(result))
    elif math.isfinite(result.mean_length_error):
        console.sentence(
            "Four body diagonals determine three angles and the mean length. Without linear tests"
            " of X, Y and Z nothing checks them."
        )
    for remark in result.remarks:
        console.sentence(f"{remark}.")
    console.sentence(report.warning)


def closure_sentence(result: SquarenessResult) -> str:
    """Say whether the body diagonals agree with the linear tests."""
    if not math.isfinite(result.closure_uncertainty) or result.closure_uncertainty == 0:
        return "How far body diagonals and linear tests should agree is unknown."
    ratio = abs(result.closure) / (COVERAGE_FACTOR * result.closure_uncertainty)
    words = "agree" if ratio <= 1 else "do NOT agree"
    return (
        f"Body diagonals and linear tests {words} in the mean length (difference {plain(ratio)} of"
        " its expanded uncertainty; drift, angular errors or the laser's scale make it larger)."
    )


def sensitivity_table() -> Any:
    """Return how far a shift of the laser's reading between two diagonals falsifies squareness."""
    table = new_table(
        "Squareness error of a shift of the reading between two diagonals, arcsec",
        "shift",
        *(f"X : Y = {ratio:g} : 1" for ratio in _RATIOS),
    )
    for shift in SHIFTS_OF_RL:
        errors = squareness_error_of_shift(shift, np.array(_RATIOS)) * ARC_SECONDS
        table.add_row(
            f"±{shift * IN_MICRO:g} ppm", *(f"±{plain(float(error))}" for error in errors)
        )
    return table
