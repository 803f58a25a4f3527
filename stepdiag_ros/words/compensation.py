"""What compensation tables leave, in sentences."""

import math

from stepdiag_ros.compensation.remaining import BeforeAndAfter
from stepdiag_ros.evaluation.compensation import CompensationReport
from stepdiag_ros.metrology.geometry import ROTATIONS
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.text.numbers import ARC_SECONDS, UNKNOWN, plain

_DECIMALS = 3


def limit_words(report: CompensationReport) -> str:
    """Say how well the errors are known that tables correct; empty where that is unknown."""
    spread = report.remainder.rms_uncertainty
    if not math.isfinite(spread):
        return ""
    return (
        "The errors in the volume are known to"
        f" {size_words(spread, 'm')} (rms standard uncertainty): no compensation made from them is"
        " better than that."
    )


def uncorrected(report: CompensationReport) -> list[str]:
    """Say what the tables do not correct, sentence by sentence, in numbers where known."""
    said = [
        f"{figure_name(one)} stays: {size_words(one.after, one.unit)}"
        for one in report.remainder.changes
        if not one.corrected and not one.name.startswith("volume")
    ]
    error_map = report.identified.error_map
    turning = [name for name in ROTATIONS if name in error_map.curves]
    volume = report.remainder.change("volume, rms")
    if turning and report.control.name != "generic":
        said.append(
            f"angular errors ({', '.join(turning)}) act by levers and stay; with them"
            f" {size_words(volume.after, 'm')} rms are left in the volume"
        )
    if error_map.learned and report.control.name != "generic":
        named = ", ".join(one.label for one in error_map.learned)
        said.append(
            f"{named}: a table of this control holds only the part that depends on the place of one"
            f" axis; {size_words(volume.after, 'm')} rms are left in the volume"
        )
    if error_map.left_out:
        said.append(
            f"{', '.join(error_map.left_out)} were not estimated: what they do in the volume is"
            " neither corrected nor in these figures"
        )
    if error_map.unknown_curves:
        said.append(f"not determined by these lines: {', '.join(error_map.unknown_curves)}")
    return said


def figure_name(one: BeforeAndAfter) -> str:
    """Return what a figure is; that of positioning is not the error at the end of the travel."""
    return (
        f"{one.name}, peak to peak with reversal"
        if one.name.startswith("positioning ")
        else one.name
    )


def size_words(value: float, unit: str) -> str:
    """Write an error in µm, or squareness (unit ``rad``) in µm/m and arc-seconds.

    What is below the last digit is written as less than this digit, never as zero: tables are as
    fine as their numbers, and what remains is not known to be nothing.
    """
    if not math.isfinite(value):
        return UNKNOWN
    if unit == "rad":
        return f'{_resolved(value * IN_MICRO, 2)} µm/m ({_resolved(value * ARC_SECONDS, 2)}")'
    return f"{_resolved(value * IN_MICRO, _DECIMALS)} µm"


def _resolved(size: float, decimals: int) -> str:
    digit = 10.0**-decimals
    return plain(size, decimals) if abs(size) >= digit else f"< {plain(digit, decimals)}"
