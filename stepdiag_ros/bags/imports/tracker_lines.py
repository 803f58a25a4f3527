"""Reads the table of a tracker's readings (``bags.tracker_table``) for a bag."""

from itertools import groupby

import numpy as np

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.imports.imported import Imported, ImportOptions
from stepdiag_ros.bags.imports.source import SourceFile
from stepdiag_ros.bags.tracker_table import REQUIRED, parse_table
from stepdiag_ros.metrology.measurement import Environment, MeasuredLine
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.refusal import fields_of
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.campaign import rough_places
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.measured_lines import pass_of, plan_of
from stepdiag_ros.metrology.tracker.readings import (
    TrackerReading,
    changes_of,
    points_of,
    uncertainties_of,
)
from stepdiag_ros.planning.plan_text import plan_text

NAME = "table of a tracker"
_ANY = Tracker("not described by the table", length_noise=0.0, length_proportional=0.0)
"""Takes every length; what a length is uncertain by stands in the table."""


def recognises(source: SourceFile) -> bool:
    """Say whether the first line of a file names the columns of this table."""
    first = source.data[:500].removeprefix(b"\xef\xbb\xbf").lstrip().split(b"\n")[0]
    names = {cell.strip().decode("utf-8", errors="replace") for cell in first.split(b",")}
    return names >= set(REQUIRED)


def read(source: SourceFile, options: ImportOptions) -> Imported:
    """Read the table: one line of the bag for each pass, all of a station with one zero.

    The rough places of the tracker, which a plan needs, are found from the readings themselves.

    Raises:
        TableError: a cell is wrong, passes do not fit together, or a station cannot be located.
    """
    readings = parse_table(source.text(options.encoding).text, source.name)
    try:
        plan = _plan(readings, source.name)
    except ValueError as error:
        raise TableError(f"{source.name}: {error}", **fields_of(error)) from None
    groups = [tuple(group) for _, group in groupby(readings, key=pass_of)]
    return Imported(
        format=NAME,
        volume=plan.volume,
        plan_text=plan_text(plan),
        lines=tuple(_line(plan, index, group) for index, group in enumerate(groups)),
        machine_text=f"chain: {options.chain}\n" if options.chain else "",
        chain=options.chain,
        remarks=()
        if options.chain
        else ("The chain of the machine is not known; no U can be given without it (--chain).",),
    )


def _plan(readings: tuple[TrackerReading, ...], source: str) -> Plan:
    points = points_of(readings)
    low, high = points.min(axis=0), points.max(axis=0)
    return plan_of(
        readings,
        rough_places(readings),
        _ANY,
        Box(low, np.maximum(high, low + 1e-3)),
        name=f"imported from {source}",
        feed=float("nan"),
    )


def _line(plan: Plan, index: int, group: tuple[TrackerReading, ...]) -> MeasuredLine:
    line, count = plan.lines[index], len(group)
    return MeasuredLine(
        line=line,
        line_index=index,
        attempt=1,
        setup=plan.setup_of(line),
        time=np.full(count, np.nan),
        # The table tells no times; the lines keep their order: one nanosecond each.
        end_time=index,
        target=points_of(group),
        displacement=changes_of(group),
        standard_uncertainty=uncertainties_of(group),
        environment=np.tile(np.array(Environment()), (count, 1)),
        overrun=float("nan"),
    )
