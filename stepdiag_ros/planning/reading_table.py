"""Writes the table of a plan that a person fills in: a row a stop, and what its columns mean."""

import csv
import io
from collections.abc import Iterator
from typing import Any

import yaml

from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import BOX_KEYS, Line, Plan, alignment_of
from stepdiag_ros.metrology.plausible import ROTATIONS_KEY
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import IN_MILLI
from stepdiag_ros.planning.plan_text import plan_text
from stepdiag_ros.text.intake import parse_yaml

READING = "reading_mm"
_EXPECTED = "expected_mm"
_NOT_READ = "-"
_COLUMNS = (
    *("line", "order", "run", "direction", "stop"),
    *("x_mm", "y_mm", "z_mm", _EXPECTED, READING),
)
_HEAD = f"""\
# What the columns of the table mean: 'stepdiag import TABLE --mapping' reads both.
# Fill in '{READING}' at every stop, in mm. It grows as the mirror moves along the beam (otherwise
# write 'sign: -1'). Zero the laser at the first stop of an alignment only, and not again before
# the next one. '{_EXPECTED}' is what a perfect machine would show then.
# Write '{_NOT_READ}' at a stop that was not read.
# If your spreadsheet writes semicolons and decimal commas: 'delimiter: semicolon' and
# 'decimal: comma' in the line 'text', in place of what stands there.
# What held during the measurement, if you know it:
#   environment: {{air_temperature_degC: 20.0, air_pressure_Pa: 101300, relative_humidity: 0.5,
#                 material_temperature_degC: 20.0}}
# Under 'facts', if you like: machine_serial_number, instrument, instrument_serial_number,
# operator, test_date.

"""


def reading_table(plan: Plan) -> str:
    """Return a table (CSV) with a row for each stop of a plan and an empty cell for its reading.

    Raises:
        Refusal: the plan is measured while the axes move, or with a tracker.
    """
    if plan.on_the_fly or plan.tracker is not None:
        raise Refusal(
            "a table to fill in needs stops: leave out --table for lines on the fly and for a"
            " tracker",
            fault="unsupported",
        )
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    writer.writerows(_rows(plan))
    return text.getvalue()


def _rows(plan: Plan) -> Iterator[tuple[Any, ...]]:
    zeros: dict[str, Any] = {}
    for line in plan.lines:
        stops = line.stops(plan.volume)
        zero = zeros.setdefault(alignment_of(line, plan.one_alignment_per_diagonal), stops[0])
        expected = line.beam(plan.volume).between(zero, stops)
        which = _name(line), line.order, line.repeat + 1, line.direction
        for stop, (position, change) in enumerate(zip(stops, expected, strict=True)):
            places = (f"{value * IN_MILLI:.6g}" for value in position)
            yield (*which, stop, *places, f"{change * IN_MILLI:.4f}", "")


def _name(line: Line) -> str:
    """Return the name of a line with its place, as the import reads it: ``z@0,0.29,0``."""
    place = ",".join(f"{value:.12g}" for value in line.offset)
    return f"{line.name}@{place}" if any(line.offset) else line.name


def table_mapping(plan: Plan, machine: Machine) -> str:
    """Return the mapping file (YAML) of a plan's table; see ``bags.imports.mapping``.

    Args:
        plan: of the table.
        machine: that is measured.
    """
    told = parse_yaml(plan_text(plan), plan.name)
    box = {key: told.pop(key) for key in BOX_KEYS}
    # How a person reads a stop is not known.
    told.pop("sampling", None)
    overrun = {"overrun_m": told.pop("overrun_m", 0.0), "overrun_of_step_diagonals_m": 0.0}
    chain = {"chain": list(machine.chain)} if machine.chain else {}
    rotations = {ROTATIONS_KEY: machine.rotations} if machine.rotations_stated else {}
    mapping = {
        "table": "lines",
        "text": {"delimiter": "comma", "decimal": "point", "rejected": _NOT_READ},
        "columns": {**{name: name for name in _COLUMNS[:5]}, "reading": READING},
        "ignored": [name for name in _COLUMNS[5:] if name != READING],
        "units": {"reading": "mm"},
        "sign": 1,
        "volume": box,
        **overrun,
        **chain,
        **rotations,
        "facts": {"machine": machine.name},
        "plan": told,
    }
    return _HEAD + yaml.safe_dump(
        mapping, sort_keys=False, default_flow_style=None, allow_unicode=True
    )
