"""A bag as tables: the run table again, stops, blocks, lines, results, and readings if wanted."""

import importlib.util
import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass
from itertools import chain
from math import isnan
from pathlib import Path
from typing import Any, Literal, get_type_hints

import numpy as np

from stepdiag_ros.bags.case import FILE_NAME as CASE_FILE
from stepdiag_ros.bags.csv_cells import csv_text, guarded
from stepdiag_ros.bags.errors import BagError, BagWriteError
from stepdiag_ros.bags.run import RecordedRun, load_run
from stepdiag_ros.bags.table_rows import ENVIRONMENT_COLUMNS
from stepdiag_ros.bags.table_writing import TABLE_NAME, WrittenTable, run_table_of
from stepdiag_ros.bags.tracker_table import table_text
from stepdiag_ros.metrology.discrepancy.summary import DiagnosisSummary
from stepdiag_ros.metrology.geometry import curve_unit
from stepdiag_ros.metrology.measurement import (
    BlockDisplacement,
    Reading,
    SettledStop,
    latest_attempts,
)
from stepdiag_ros.metrology.plan import Line
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.tracker.measured_lines import readings_of

Format = Literal["csv", "parquet"]
Row = Sequence[Any]

LINE_COLUMNS = ("line_index", "attempt", "kind", "line", "order", "repeat", "direction")
POSITION_COLUMNS = ("x_m", "y_m", "z_m")
TRACKER_FILE = "tracker.csv"
"""Of a run with a tracker: its readings as ``stepdiag tracker evaluate`` takes them."""
_GAP_COLUMNS = ("chi_squared", "degrees_of_freedom", "p_value", "rms_m", "largest_m")


@dataclass(frozen=True)
class ExportedTable:
    """One table: its name, the names of its columns, and its rows."""

    name: str
    columns: Sequence[str]
    rows: Iterable[Row]


@dataclass(frozen=True)
class ExportReport:
    """What was written, and what could not be: files in the order of writing, sentences."""

    files: tuple[Path, ...]
    remarks: tuple[str, ...]


def export_bag(
    bag: str | Path,
    folder: str | Path,
    format: Format = "csv",
    *,
    readings: bool = False,
    overwrite: bool = False,
    run_id: str | None = None,
) -> ExportReport:
    """Write a bag's run as tables, in SI units, every number with all its digits.

    ``run`` is a run table again (with ``case.yaml`` beside it), each line with its last attempt;
    an import makes the same measurement of it. ``lines``, ``stops``, ``blocks`` hold every attempt;
    ``results`` the error curves with standard uncertainties and ``figures`` the single figures,
    each solver's last; of a run with a tracker its table (``bags.tracker_table``) stands in place
    of the run table; ``diagnoses`` every verdict beside the run, ``findings`` the sizes of the
    effects that the last one found. Unknown numbers are empty cells; texts in CSV that a
    spreadsheet would execute have an apostrophe before them (``csv_cells``).

    Args:
        bag: the bag.
        folder: where the files go; made if it is not there.
        format: ``csv``, or ``parquet`` if pyarrow is installed.
        readings: write every reading of the interferometer too.
        overwrite: replace files that exist.
        run_id: which run, where the bag holds several.

    Raises:
        BagError: the bag cannot be read, a file exists, or pyarrow is missing.
        BagWriteError: a file cannot be written.
        ValueError: the format is unknown.
    """
    if format not in ("csv", "parquet"):
        raise Refusal(f"'{format}' is not a format of tables; use csv or parquet", fault="unknown")
    if format == "parquet" and importlib.util.find_spec("pyarrow") is None:
        raise BagError(
            "Parquet needs pyarrow, which is not installed: pip install pyarrow, or use csv",
            fault="not_installed",
        )
    run = load_run(bag, run_id)
    folder = Path(folder)
    tracked = run.plan.tracker is not None
    written = run_table_of(run) if run.lines and not tracked else None
    tables = [table for table in _tables(run, written, readings) if table is not None]
    writers: list[tuple[Path, Callable[[], bytes]]] = [
        (folder / f"{table.name}.{format}", _encoder(table, format)) for table in tables
    ]
    if written is not None:
        case = written.case.case_text().encode()
        writers.append((folder / CASE_FILE, lambda: case))
    if tracked:
        table = table_text(readings_of(run.plan, run.measurement.lines)).encode()
        writers.append((folder / TRACKER_FILE, lambda: table))
    existing = [path for path, _ in writers if path.exists()]
    if existing and not overwrite:
        raise BagError(
            f"{existing[0]} exists already; choose another folder or allow overwriting",
            fault="exists",
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path, make in writers:
            _write_whole(path, make())
    except OSError as error:
        raise BagWriteError(f"{folder} cannot be written: {error.strerror}") from error
    return ExportReport(tuple(path for path, _ in writers), tuple(_remarks(run, written)))


def _remarks(run: RecordedRun, written: WrittenTable | None) -> Iterator[str]:
    yield from (flaw.sentence for flaw in run.flaws)
    if run.plan.tracker is not None:
        return
    if written is None:
        yield "The bag holds no finished line, so there is no run table."
        return
    for line in latest_attempts(run.lines):
        if not line.complete:
            yield (
                f"Line '{line.line}' has stops without a value; the run table marks them"
                " (settled: false)."
            )
    if written.refused:
        yield f"The run table cannot be imported again: {written.refused}"


def _tables(
    run: RecordedRun, written: WrittenTable | None, readings: bool
) -> Iterator[ExportedTable | None]:
    yield ExportedTable(TABLE_NAME, written.columns, written.rows) if written else None
    yield _lines_table(run) if run.lines else None
    yield _stops_table(run) if run.stops else None
    yield _blocks_table(run) if run.blocks else None
    latest = {result.method: result for result in run.results}
    if latest:
        yield _results_table(latest)
        yield ExportedTable(
            "figures",
            ("method", "figure", "value", "standard_uncertainty", "unit"),
            [
                (method, figure.name, figure.value, figure.standard_uncertainty, figure.unit)
                for method, result in latest.items()
                for figure in result.figures
            ],
        )
    if run.diagnoses:
        yield _diagnoses_table(run.diagnoses)
        yield _findings_table(run.diagnoses[-1])
    if readings:
        yield _readings_table(run)


def _identity(line: Line, line_index: int, attempt: int) -> Row:
    return (line_index, attempt, line.kind, line.name, line.order, line.repeat, line.direction)


def _lines_table(run: RecordedRun) -> ExportedTable:
    return ExportedTable(
        "lines",
        (
            *LINE_COLUMNS,
            "setup",
            "stop",
            "time_s",
            *POSITION_COLUMNS,
            "displacement_m",
            "standard_uncertainty_m",
            *ENVIRONMENT_COLUMNS,
        ),
        [
            (
                *_identity(line.line, line.line_index, line.attempt),
                line.setup,
                stop,
                line.time[stop],
                *line.target[stop],
                line.displacement[stop],
                line.standard_uncertainty[stop],
                *line.environment[stop],
            )
            for line in run.lines
            for stop in range(len(line.time))
        ],
    )


def _own_columns(kind: type, told: Sequence[str]) -> dict[str, str]:
    """Return a column for each further field of a data class: its name with the unit → the field.

    Fields that are not a single number or text need columns of their own, named in the table.

    Args:
        kind: the data class.
        told: fields that have columns of their own.
    """
    exact, plain = get_type_hints(kind, include_extras=True), get_type_hints(kind)
    return {
        "_".join((name, *getattr(hint, "__metadata__", ()))): name
        for name, hint in exact.items()
        if name not in told and plain[name] in (bool, int, float, str)
    }


def _stops_table(run: RecordedRun) -> ExportedTable:
    own = _own_columns(SettledStop, ("command", "line", "position", "time", "environment"))
    return ExportedTable(
        "stops",
        (
            *(*LINE_COLUMNS, "setup", "stop", "axis", "time_ns"),
            *POSITION_COLUMNS,
            *(f"actual_{name}" for name in POSITION_COLUMNS),
            *own,
            *ENVIRONMENT_COLUMNS,
        ),
        [
            (
                *_identity(stop.line, stop.command.line_index, stop.command.attempt),
                *(stop.command.setup, stop.command.stop, stop.command.axis, stop.time),
                *stop.command.target,
                *stop.position,
                *(getattr(stop, field) for field in own.values()),
                *stop.environment,
            )
            for stop in run.stops
        ],
    )


def _blocks_table(run: RecordedRun) -> ExportedTable:
    own = _own_columns(BlockDisplacement, ("line_index", "attempt", "line", "time"))
    return ExportedTable(
        "blocks",
        (*LINE_COLUMNS, "time_ns", *own),
        [
            (
                *_identity(block.line, block.line_index, block.attempt),
                block.time,
                *(getattr(block, field) for field in own.values()),
            )
            for block in run.blocks
        ],
    )


def _results_table(latest: dict[str, Any]) -> ExportedTable:
    return ExportedTable(
        "results",
        ("method", "curve", "node", "position_m", "unit", "error", "standard_uncertainty"),
        [
            (
                method,
                name,
                node,
                position,
                curve_unit(name),
                result.curves[name][node],
                result.standard_uncertainty[name][node],
            )
            for method, result in latest.items()
            for name in result.curves
            for node, position in enumerate(result.nodes_of(name))
        ],
    )


def _diagnoses_table(diagnoses: Sequence[DiagnosisSummary]) -> ExportedTable:
    return ExportedTable(
        "diagnoses",
        (
            "time_ns",
            "lines",
            "run_over",
            "verdict",
            "sentence",
            "noise_m",
            *(f"{name}_{when}" for when in ("before", "after") for name in _GAP_COLUMNS),
            "model",
            "model_sha256",
        ),
        [
            (
                one.time,
                one.lines,
                one.run_over,
                one.verdict,
                one.sentence,
                one.noise,
                *(value for gap in (one.before, one.after) for value in astuple(gap)),
                one.model.name,
                one.model.sha256,
            )
            for one in diagnoses
        ],
    )


def _findings_table(diagnosis: DiagnosisSummary) -> ExportedTable:
    return ExportedTable(
        "findings",
        (
            "label",
            "effect",
            "closes",
            "size",
            "value",
            "standard_uncertainty",
            "band_95_low",
            "band_95_high",
            "unit",
            "gain",
            "p_value",
            "probability",
            "ambiguous_with",
        ),
        [
            (
                found.label,
                found.effect,
                closes,
                size.name,
                size.value,
                size.standard_uncertainty,
                *size.band,
                size.unit,
                found.gain,
                found.p_value,
                found.probability,
                "; ".join(found.ambiguous_with),
            )
            for closes, effects in (("all", diagnosis.findings), ("a part", diagnosis.partial))
            for found in effects
            for size in found.sizes
        ],
    )


def _readings_table(run: RecordedRun) -> ExportedTable:
    own = _own_columns(Reading, ("environment",))
    return ExportedTable(
        "readings",
        (*own, *ENVIRONMENT_COLUMNS),
        (
            (*(getattr(reading, field) for field in own.values()), *reading.environment)
            for reading in run.readings()
        ),
    )


def _encoder(table: ExportedTable, format_: Format) -> Callable[[], bytes]:
    return (lambda: _csv(table)) if format_ == "csv" else (lambda: _parquet(table))


def _csv(table: ExportedTable) -> bytes:
    rows = ([_cell(value) for value in row] for row in table.rows)
    return csv_text(chain([table.columns], rows)).encode()


def _cell(value: Any) -> str:
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    if isinstance(value, float):
        # The shortest text that gives the same number again.
        return "" if isnan(value) else repr(float(value))
    return guarded(value) if isinstance(value, str) else str(value)


def _parquet(table: ExportedTable) -> bytes:
    import pyarrow  # type: ignore[import-not-found,import-untyped,unused-ignore]
    import pyarrow.parquet  # type: ignore[import-not-found,import-untyped,unused-ignore]

    columns = list(zip(*table.rows, strict=True)) or [() for _ in table.columns]
    arrays = {
        name: pyarrow.array([_plain(value) for value in column])
        for name, column in zip(table.columns, columns, strict=True)
    }
    sink = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(arrays), sink)
    return sink.getvalue()


def _plain(value: Any) -> Any:
    """Return a number of numpy as Python's; unknown numbers as none, as Parquet has them."""
    plain = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(plain, float) and isnan(plain) else plain


def _write_whole(path: Path, content: bytes) -> None:
    # Beside the target and then renamed, so that a file that is there is whole.
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.write_bytes(content)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
