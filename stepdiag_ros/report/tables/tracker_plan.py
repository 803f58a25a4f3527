"""A planned seven-line test as tables and sentences."""

from collections.abc import Sequence

import numpy as np

from stepdiag_ros.metrology.tracker.expectation import TrackerExpectation
from stepdiag_ros.metrology.tracker.seven_lines import SevenLineTest
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.planning.proposal import hours
from stepdiag_ros.planning.tracker_duration import SevenLineDuration
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import plain
from stepdiag_ros.text.table import new_table

_ALONE, _USUAL = "lengths alone", "lengths and a usual machine"


def print_test(
    test: SevenLineTest, expectation: TrackerExpectation, station: str, console: PlainConsole
) -> None:
    """Print a planned test: its lines, what it will determine, what is left out, remarks."""
    table = new_table(
        f"Seven-line test, station {station}",
        "line",
        "from / mm",
        "to / mm",
        "length / mm",
        "targets",
        "tracker beside / mm",
        "beam off the line",
    )
    for line in test.lines:
        table.add_row(
            line.name,
            _place(line.targets[0]),
            _place(line.targets[-1]),
            plain(line.length * IN_MILLI, 1),
            str(len(line.targets)),
            plain(line.offset * IN_MILLI, 1),
            f"{np.degrees(line.obliqueness):.0f}°",
        )
    console.print(table)
    console.print(f"{len(test.locating)} places locate the tracker; {test.runs} runs each way.")
    told = new_table("Expected U (95 %)", "", "of", "unit", "U")
    told.whole_title = True
    for letter, spread in zip("XYZ", expectation.position, strict=True):
        told.add_row(
            f"tracker {letter}, from its places",
            _ALONE,
            "µm",
            plain(COVERAGE_FACTOR * spread * IN_MICRO),
        )
    for name, spread in expectation.joint.items():
        told.add_row(
            f"{name}, from all readings", _USUAL, "µm/m", plain(COVERAGE_FACTOR * spread * IN_MICRO)
        )
    for name, one in expectation.separations.items():
        if not isinstance(one, str):
            for what, spread in zip(("scale", "lean to the tracker"), one, strict=False):
                told.add_row(
                    f"line {name} alone, {what}",
                    _ALONE,
                    "µm/m",
                    plain(COVERAGE_FACTOR * spread * IN_MICRO),
                )
    console.print(told)
    for name, one in expectation.separations.items():
        if isinstance(one, str):
            console.print(f"Line {name} alone: {one}.")
    for text in expectation.warnings:
        console.print(text)
    for name, reason in test.left_out.items():
        console.print(f"Left out: line {name}, {reason}.")
    for text in test.remarks:
        console.print(text)


def duration_sentences(duration: SevenLineDuration | str) -> list[str]:
    """Say how long a test takes, beside a conventional laser; or why that is not known."""
    if isinstance(duration, str):
        return [f"Duration: unknown, {duration}."]
    return [
        f"Duration: {hours(duration.tracker)} with the tracker, {hours(duration.setting_up)} of it"
        f" to set it up; {hours(duration.laser)} with a conventional laser, aligned again for"
        f" each of {duration.lines} lines, {hours(duration.laser_aligning)} of it to align:"
        f" {duration.laser / duration.tracker:.1f} times as long (ATLI: 2 to 3"
        " times).",
    ]


def _place(place: Sequence[float]) -> str:
    return ", ".join(f"{value * IN_MILLI:.1f}" for value in place)
