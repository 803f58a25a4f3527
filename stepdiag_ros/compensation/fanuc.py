"""Stored pitch error compensation for Fanuc: increments at even intervals, positioning alone.

Source: FANUC, Series 0i-PB Parameter Manual (B-63980EN/01), section 4 "Description of parameters",
parameters 3620 to 3624 with their examples, and Technical Report A-77810E "Bidirectional pitch
error compensation" (parameters 3605#0, 3626, 3627). With r the number of the reference position
(3620) and d the interval (3624), point n belongs to the section from (n-r-1) d to (n-r) d from the
reference position, seen in the positive direction; its value is what the compensation changes
there, in detection units times the magnification (3623), -7 to +7. 3621 and 3622 are the numbers
of the points farthest in the negative and in the positive direction, at most 128 points an axis.
The sum from the reference position on is the correction, output where a section's point lies, which
the manual's figure shows in the middle of the section.

What differs from control to control: larger values (-128 to +127) and interpolation between points
are options; files are read with ``N…P…`` by older and ``N…Q0P…`` by 30i controls (Series 30i
Parameter Manual B-63950EN, section 3). The manuals that are public show the sum as an amount that
is output to the axis, so a positive value is taken to move it in the positive direction.
"""

import re
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.compensation.applied import ControlTable, TableSet
from stepdiag_ros.compensation.control import (
    AXIS,
    ControlSetting,
    Files,
    Layout,
    axis_names,
    refuse_far,
    refuse_large,
    refuse_long,
    wanted,
)
from stepdiag_ros.compensation.identified import Identified
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import IN_MILLI
from stepdiag_ros.text.controls import NUMBER, Comment

PITCH = "PITCH.TXT"
PARAMETERS = "parameters_3620.txt"
MOST_POINTS = 128
USUAL_POINTS = 100
"""Of an axis, if no spacing is asked for."""
LARGEST = 1e-3
"""m."""
_LARGEST_MAGNIFICATION = 100
COMMENT = Comment("# ")
"""In the file that a person reads, so that no text of a bag looks like a parameter."""
_BY_HAND = "set these by hand, then load the points:"
_LINE = re.compile(r"N(\d+)(?:Q0)?P(-?\d+)\s*;?")
_TOLD = re.compile(r"(\d{4}) (\S+) = (-?[\d.]+)")


class _Fanuc:
    name = "fanuc"
    title = "Fanuc (stored pitch error compensation)"
    settings = (
        ControlSetting("axes", "X,Y,Z", "names of the axes"),
        ControlSetting(
            "detection_unit_um", 1.0, "detection unit of the axes, µm", low=0.001, high=100.0
        ),
        ControlSetting(
            "value_limit", 7, "largest value of a point: 7, or 127 with the option", 1, 127
        ),
        ControlSetting(
            "magnification",
            0,
            "parameter 3623; 0: the smallest with which every value fits",
            high=_LARGEST_MAGNIFICATION,
        ),
        ControlSetting("first_number", 0, "number of the first point of X", high=1023),
        ControlSetting("form", "NP", "lines of the file: NP or NQP (30i)", choices=("NP", "NQP")),
    )
    corrects = ("E_XX", "E_YY", "E_ZZ")
    says = (
        "values are whole detection units times the magnification: what is finer stays",
        "reversal errors stay uncorrected: backlash is parameter 1851, 1852",
        "straightness is a separate option of the control (parameters 5700 on) with few points, and"
        " is not written; squareness and angles stay uncorrected",
        "a positive value is taken to move the axis in the positive direction: load one axis first,"
        " measure, and if the error has doubled, change all signs",
        "the sections begin at the reference position of the axis: give it with --reference if it"
        " is not machine zero",
    )
    source = "FANUC, Series 0i-PB Parameter Manual B-63980EN/01, parameters 3620 to 3624"
    grammar: ClassVar[dict[str, tuple[str, ...]]] = {
        re.escape(PITCH): ("%", r"N1[0-9]{4}(Q0)?P-?[0-9]{1,3}"),
        re.escape(PARAMETERS): (
            COMMENT.pattern,
            "",
            re.escape(_BY_HAND),
            rf"362[0-4] {AXIS} = {NUMBER}",
            rf"reference position of {AXIS}, mm: {NUMBER}",
            rf"detection unit of {AXIS}, µm: {NUMBER}",
        ),
    }

    def holds_reversal(self, _settings: Mapping[str, Any]) -> bool:
        """Say whether the tables correct reversal errors (see ``Control``)."""
        return False

    def write(self, identified: Identified, layout: Layout) -> Files:
        """Return the points, and the parameters that belong to them."""
        chosen = layout.settings
        unit = chosen["detection_unit_um"] * 1e-6
        first = chosen["first_number"]
        points: list[str] = []
        told = [*layout.comments(COMMENT), "", _BY_HAND]
        for axis, name in enumerate(axis_names(chosen["axes"])):
            nodes = identified.error_map.nodes[axis]
            refuse_far(np.array([*nodes, layout.reference[axis]]), f"the table of {name}")
            low, high = float(nodes[0]), float(nodes[-1])
            reference = layout.reference[axis]
            # Steps leave the less the finer they are; they reach from the reference position on.
            reach = max(high, reference) - min(low, reference)
            interval = _whole(layout.spacing or _whole(reach / USUAL_POINTS, 1e-3), 1e-6)
            begin, end = _sections(low, high, reference, interval)
            places = reference + interval * np.arange(begin, end + 1, dtype=np.float64)
            added = wanted(identified, axis, axis, places, layout, 0)
            refuse_large(added, LARGEST, f"the table of {name}")
            increments, magnification = _increments(added, unit, chosen, name)
            number = first - min(begin + 1, 0)
            last = number + max(end, 0)
            refuse_long(
                last - first + 1, MOST_POINTS, f"the table of {name}", "ask for a wider --spacing"
            )
            for n in range(first, last + 1):
                place = n - number - 1 - begin
                value = increments[place] if 0 <= place < len(increments) else 0
                q = "Q0" if chosen["form"] == "NQP" else ""
                points.append(f"N{10000 + n}{q}P{value}")
            told += [
                f"3620 {name} = {number}",
                f"3621 {name} = {first}",
                f"3622 {name} = {last}",
                f"3623 {name} = {magnification}",
                f"3624 {name} = {interval * IN_MILLI:.6f}",
                f"reference position of {name}, mm: {reference * IN_MILLI:.6f}",
                f"detection unit of {name}, µm: {chosen['detection_unit_um']:.6f}",
            ]
            first = last + 1
        return {PITCH: "\n".join(["%", *points, "%", ""]), PARAMETERS: "\n".join([*told, ""])}

    def read(self, files: Mapping[str, str]) -> TableSet:
        """Return what the control does with the points and the parameters."""
        if PITCH not in files or PARAMETERS not in files:
            raise ValueError(f"{PITCH} and {PARAMETERS} are needed together")
        values = _values(files[PITCH])
        parameters, references, units = _parameters(files[PARAMETERS])
        tables = []
        for axis, name in enumerate(references):
            try:
                one = [parameters[(key, name)] for key in range(3620, 3625)]
            except KeyError as missing:
                raise Refusal(f"{PARAMETERS}: {missing} is missing", fault="missing") from None
            number, first, last, magnification = (int(value) for value in one[:4])
            interval = one[4] / IN_MILLI
            numbers = np.arange(first - 1 - number, last - number + 1, dtype=np.float64)
            places = references[name] + interval * numbers
            steps = [values.get(n, 0) * magnification * units[name] for n in range(first, last + 1)]
            summed = np.concatenate([[0.0], np.cumsum(steps)])
            # Zero at the reference position, which is the place number - (first - 1).
            summed = summed - summed[number - first + 1]
            tables.append(ControlTable(axis, axis, places, summed, summed, stepped=True))
        return TableSet(tuple(tables))


def _sections(low: float, high: float, reference: float, interval: float) -> tuple[int, int]:
    """Return the first and the last multiple of the interval, from the reference, round a range."""
    begin = int(np.floor((low - reference) / interval + 1e-6))
    end = int(np.ceil((high - reference) / interval - 1e-6))
    return begin, end


def _increments(
    added: Vector, unit: float, chosen: Mapping[str, int], name: str
) -> tuple[list[int], int]:
    """Return the values of the sections, and the magnification.

    The sums are rounded, not the increments, so that rounding does not add up.

    Raises:
        ValueError: a value does not fit whatever the magnification.
    """
    limit, asked = chosen["value_limit"], chosen["magnification"]
    for magnification in (asked,) if asked else range(1, _LARGEST_MAGNIFICATION + 1):
        sums: NDArray[np.int64] = np.rint(added / (unit * magnification)).astype(np.int64)
        found = np.diff(sums)
        if np.all(np.abs(found) <= limit):
            return found.tolist(), magnification
    raise Refusal(
        f"{name}: the correction changes by more than {limit} units in one interval; take a smaller"
        " --spacing, a larger magnification, or the option for larger values (value_limit=127)",
        fault="out_of_range",
        aspect="change",
    )


def _whole(interval: float, unit: float) -> float:
    """Return an interval as a whole number of units, m, no shorter than asked for."""
    return max(int(np.ceil(interval / unit - 1e-6)), 1) * unit


def _values(text: str) -> dict[int, int]:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if len(lines) < 2 or lines[0] != "%" or lines[-1] != "%":
        raise ValueError(f"{PITCH}: it does not begin and end with %")
    values = {}
    for number, line in enumerate(lines[1:-1], 2):
        found = _LINE.fullmatch(line)
        if found is None:
            raise Refusal(
                f"{PITCH} line {number}: '{line}' is not understood",
                fault="malformed",
                aspect="line",
            )
        values[int(found[1]) - 10000] = int(found[2])
    return values


def _parameters(
    text: str,
) -> tuple[dict[tuple[int, str], float], dict[str, float], dict[str, float]]:
    parameters: dict[tuple[int, str], float] = {}
    references: dict[str, float] = {}
    units: dict[str, float] = {}
    for line in text.splitlines():
        if found := _TOLD.fullmatch(line.strip()):
            parameters[(int(found[1]), found[2])] = float(found[3])
        elif line.startswith("reference position of "):
            name, _, value = line.removeprefix("reference position of ").partition(", mm: ")
            references[name] = float(value) / IN_MILLI
        elif line.startswith("detection unit of "):
            name, _, value = line.removeprefix("detection unit of ").partition(", µm: ")
            units[name] = float(value) * 1e-6
    return parameters, references, units


CONTROL = _Fanuc()
