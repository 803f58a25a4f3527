"""The tables of a catalogue: one definition of their columns, for files, readers and pages."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import datetime
from types import UnionType
from typing import Annotated, Any, TypeAlias, get_args, get_origin, get_type_hints

from stepdiag_ros.schemas.parts import means

VERSION = 1
"""Of the tables. It grows when a column changes its meaning or goes; new columns do not change it.

A catalogue is in a folder of its version, so that programs of different versions share an archive.
"""
_SHA256 = "SHA-256 of the bag, 64 hexadecimal digits"


@dataclass(frozen=True, kw_only=True)
class Key:
    """What each row begins with: from which run it is, and in which part of the catalogue."""

    part: Annotated[str, means("Part of the catalogue that the row is in: name of its files.")]
    bag_sha256: Annotated[str, means(f"{_SHA256}.")]
    run_id: Annotated[str | None, means("Identity of the run.")]
    machine: Annotated[str | None, means("Name of the machine, as the bag states it.")]
    serial_number: Annotated[str | None, means("Of the machine.")]
    start_time: Annotated[
        datetime | None,
        means("When the run began by the clock of its computer, UTC; empty before 1973."),
    ]


@dataclass(frozen=True, kw_only=True)
class Run(Key):
    """One row a run. A bag that cannot be evaluated has one row, with its `problem`."""

    run_number: Annotated[int, means("Place among the runs of its bag, from 1.")]
    file: Annotated[str, means("Name of the bag when it was added.")]
    instrument: Annotated[
        str | None, means("Name of the instrument; of a recorded run the driver that read it.")
    ]
    instrument_serial_number: Annotated[str | None, means("Of the instrument.")]
    weather_station: Annotated[
        str | None, means("Of a recorded run: `hardware_id` of its sensors, else their driver.")
    ]
    plan: Annotated[str | None, means("Name of the test plan.")]
    chain: Annotated[str | None, means("Order of the axes from workpiece to tool, such as YXZ.")]
    simulated: Annotated[bool | None, means("The machine is a simulated cell.")]
    layout: Annotated[
        str | None,
        means(
            "SHA-256 of the measured box and lines: runs with the same layout and method share the"
            " systematic errors that rotations of the axes cause; empty if made by an earlier"
            " version."
        ),
    ]
    complete: Annotated[bool | None, means("All lines of the plan were measured.")]
    flaws: Annotated[int | None, means("Number of faults of the recording.")]
    air_temperature_degC: Annotated[float | None, means("Mean over all stops.")]  # noqa: N815
    material_temperature_degC: Annotated[float | None, means("Mean over all stops.")]  # noqa: N815
    material_temperature_range_K: Annotated[  # noqa: N815
        float | None, means("Highest less lowest at a stop.")
    ]
    air_pressure_Pa: Annotated[float | None, means("Mean over all stops.")]  # noqa: N815
    relative_humidity: Annotated[float | None, means("Mean over all stops, 0 to 1.")]
    method: Annotated[str | None, means("Method of the solver to rely on.")]
    largest_m: Annotated[float | None, means("Longest error vector in the measured box, m.")]
    largest_expanded_uncertainty_m: Annotated[
        float | None, means("Expanded uncertainty U (95 %) of `largest_m`, m.")
    ]
    largest_upper_bound_m: Annotated[
        float | None,
        means(
            "What the error is below, with 95 %, at every place of the box, m; empty if made by an"
            " earlier version."
        ),
    ]
    verdict: Annotated[str | None, means("Of the diagnosis, such as CONSISTENT or NAMED.")]
    verdict_sentence: Annotated[str | None, means("The verdict in words.")]
    effects: Annotated[Sequence[str], means("Labels of the effects that act, strongest first.")]
    contained: Annotated[
        bool | None,
        means(
            "All that acts is rotations of the axes, which every uncertainty contains; empty if"
            " made by an earlier version."
        ),
    ]
    problem: Annotated[str | None, means("Why the run could not be evaluated; empty if it was.")]
    run_software_version: Annotated[str | None, means("Of stepdiag_ros that made the run.")]
    software_version: Annotated[str, means("Of stepdiag_ros that evaluated the run.")]
    figure_count: Annotated[int, means("Rows of this run in `figures`.")]
    curve_count: Annotated[int, means("Rows of this run in `curves`.")]


@dataclass(frozen=True, kw_only=True)
class Figure(Key):
    """One row a figure: each scalar result of a run, with its uncertainty."""

    kind: Annotated[
        str,
        means(
            "`result`: a figure of a method; `volume`: longest error vector in the measured box;"
            " `single`: one error over its travel, peak to peak; `ISO 230-2`, `ISO 230-6`: a"
            " parameter of a test of positioning; `effect`: a size of an effect that acts."
        ),
    ]
    method: Annotated[str | None, means("Method of the solver that gave it.")]
    name: Annotated[
        str, means("Such as `C0Y`, `straightness E_YX`, `A X` or `backlash of X: lost_motion`.")
    ]
    unit: Annotated[str, means("Of value, uncertainties and band; SI.")]
    value: Annotated[float | None, means("Empty if the lines do not determine it.")]
    standard_uncertainty: Annotated[float | None, means("k = 1.")]
    scatter_standard_uncertainty: Annotated[
        float | None,
        means(
            "k = 1, the part that differs from run to run. The rest, from rotations that no reading"
            " shows, is the same in all runs of a layout. Empty where the two are not separated."
        ),
    ]
    expanded_uncertainty: Annotated[float | None, means("U, coverage probability 95 %.")]
    low: Annotated[float | None, means("Lower end of the 95 % coverage interval.")]
    high: Annotated[float | None, means("Upper end of the 95 % coverage interval.")]
    relied_on: Annotated[bool, means("Of the method to rely on, or of none.")]


@dataclass(frozen=True, kw_only=True)
class Curve(Key):
    """One row an error curve of a method."""

    method: Annotated[str, means("Method of the solver.")]
    name: Annotated[str, means("ISO 230-1 name, such as `E_XX`.")]
    unit: Annotated[str, means("Of value and uncertainty: m or rad.")]
    position_m: Annotated[Sequence[float], means("Nodes along the axis, m.")]
    value: Annotated[Sequence[float], means("Error at each node; empty where not determined.")]
    standard_uncertainty: Annotated[Sequence[float], means("Of each value, k = 1.")]
    relied_on: Annotated[bool, means("Of the method to rely on.")]


Row: TypeAlias = Run | Figure | Curve
TABLES: Mapping[str, type[Row]] = {"runs": Run, "figures": Figure, "curves": Curve}
"""Name of each table, which is the folder of its files → class of its rows."""
_TYPES = {
    str: ("string", "text"),
    int: ("int64", "whole number"),
    float: ("float64", "number"),
    bool: ("bool_", "yes or no"),
}


def described(table: str) -> dict[str, tuple[str, str]]:
    """Return the columns of a table, for a page: name → type in words, and meaning."""
    told = {}
    for name, (kind, many, meaning) in _columns(table).items():
        words = "time" if kind is datetime else _TYPES[kind][1]
        told[name] = f"list of {words}s" if many else words, meaning
    return told


def schema(table: str) -> Any:
    """Return the columns of a table as a schema of pyarrow, with their meaning."""
    import pyarrow

    made = []
    for name, (kind, many, meaning) in _columns(table).items():
        known = getattr(pyarrow, _TYPES[kind][0])() if kind in _TYPES else None
        one = pyarrow.timestamp("us", "UTC") if known is None else known
        whole = pyarrow.list_(one) if many else one
        made.append(pyarrow.field(name, whole, metadata={"description": meaning}))
    return pyarrow.schema(made)


def _columns(table: str) -> dict[str, tuple[type, bool, str]]:
    """Return name → type of a value, whether there are many of them, and meaning."""
    hints = get_type_hints(TABLES[table], include_extras=True)
    found = {}
    for field in fields(TABLES[table]):
        hint, meaning = get_args(hints[field.name])
        many = get_origin(hint) is not None and get_origin(hint) is not UnionType
        kind = get_args(hint)[0] if many or get_origin(hint) is UnionType else hint
        found[field.name] = kind, many, str(meaning.description)
    return found
