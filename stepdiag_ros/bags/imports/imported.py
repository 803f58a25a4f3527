"""What an importer hands over: lines of a measurement, or a stream of readings, and what is known.

Whatever the file does not state is unknown: NaN in numbers, and not among the facts.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from stepdiag_ros.metrology.measurement import MeasuredLine, Reading
from stepdiag_ros.metrology.plan import Volume

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Two opposite corners, the lower first: machine coordinates, m."""


@dataclass(frozen=True)
class ImportOptions:
    """What the user says about a file.

    Attributes:
        axis: axis or diagonal that was tested (X, ppp, …), where the file does not state it.
        box: measured volume that tested diagonals cross; None if not given.
        standing: machine coordinates of the axes that stand, m, X Y Z; None if not known.
        directions: how runs were measured that all stand in the same order in the file: ``same``
            (all in the order in which they stand) or ``alternating`` (every second one the other
            way round); empty if not said.
        encoding: of the text; empty to find out.
        decimal: sign in numbers, ``.`` or ``,``.
        mapping: path of the file that says what the columns are; empty without one.
        overrun: how far beyond its first target each run along an axis was begun, m; 0 if it was
            not, NaN if that is not known.
        plan: YAML text of the plan that a stream of readings was measured by; empty without one.
        chain: order of the axes from workpiece to tool, of a tracker's table; empty if not said.
    """

    axis: str = ""
    box: Box | None = None
    standing: tuple[float, float, float] | None = None
    directions: str = ""
    encoding: str = ""
    decimal: str = "."
    overrun: float = math.nan
    mapping: str = ""
    plan: str = ""
    chain: str = ""


@dataclass(frozen=True)
class Imported:
    """What a file holds.

    Attributes:
        format: of the file, in words.
        volume: the measured box.
        plan_text: YAML of a plan that measures these lines.
        lines: finished lines in the order of measurement; empty for a stream of readings.
        readings: a stream of readings; empty otherwise.
        machine_text: YAML of what is known of the machine.
        facts: name → text: machine, serial numbers, dates, conditions, as the file has them.
        remarks: what the reader of the results must know, in words.
        chain: order of the axes from workpiece to tool; empty if not known.
        further: other files that the import was made with: name → text.
    """

    format: str
    volume: Volume
    plan_text: str
    lines: tuple[MeasuredLine, ...] = ()
    readings: tuple[Reading, ...] = ()
    machine_text: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    chain: str = ""
    further: Mapping[str, str] = field(default_factory=dict)

    @property
    def stops(self) -> int:
        """Return the number of stops of all lines."""
        return sum(len(line.displacement) for line in self.lines)
