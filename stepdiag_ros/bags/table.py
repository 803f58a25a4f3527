"""Run tables: read one, make a bag from one. The way back is ``export.export_bag``.

A run table is CSV with one row a stop (``table_rows.COLUMNS``); beside it may stand a ``case.yaml``
with what is known of the machine and the laser. A table is taken whole or refused, with the row and
the reason.
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from stepdiag_ros import conversion, topics
from stepdiag_ros.bags.case import FILE_NAME, Case, read_case
from stepdiag_ros.bags.errors import BagError, BagWriteError
from stepdiag_ros.bags.header import Attachment, RunHeader
from stepdiag_ros.bags.table_lines import (
    measured_lines,
    passes_of,
    plan_groups,
    setups_of,
    volume_of,
)
from stepdiag_ros.bags.table_rows import parse_rows, read_text
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.metrology.checking import UNKNOWN
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import Volume

SOURCE_PREFIX = "source/"
"""In front of the names of the files that an imported bag was made from."""


@dataclass(frozen=True)
class RunTable:
    """A run table that was read and checked.

    Attributes:
        path: of the CSV.
        text: of the CSV.
        case: what the case file tells.
        measurement: box and lines; a line's index is its place in the plan.
        plan_text: YAML of a plan that measures these lines; its feed is ``unknown``.
        setups: number of setups.
    """

    path: Path
    text: str
    case: Case
    measurement: Measurement
    plan_text: str
    setups: int

    @property
    def stops(self) -> int:
        """Return the number of rows."""
        return sum(len(line.time) for line in self.measurement.lines)


def load_table(path: str | Path, case: str | Path | None = None) -> RunTable:
    """Read a run table with its case file.

    Args:
        path: the CSV.
        case: the case file; by default ``case.yaml`` beside the table, if there is one.

    Raises:
        TableError: not there, not readable, incomplete or contradictory; names row and reason.
    """
    path = Path(path)
    text = read_text(path)
    rows = parse_rows(text, str(path))
    beside = path.with_name(FILE_NAME)
    told = Case()
    if case is not None or beside.is_file():
        told = read_case(Path(case) if case is not None else beside)
    passes = passes_of(rows, str(path))
    volume = told.volume or volume_of(passes, str(path))
    setups = setups_of(passes, volume, str(path))
    lines = tuple(line for _, line in measured_lines(setups, told))
    plan = {
        "name": f"imported from {path.name}",
        "origin_m": list(volume.origin),
        "step_m": list(volume.step),
        "blocks": volume.blocks,
        "feed_m_per_s": UNKNOWN,
        "lines": plan_groups(setups),
    }
    return RunTable(
        path=path,
        text=text,
        case=told,
        measurement=Measurement(volume, lines, told.chain),
        plan_text=yaml.safe_dump(plan, sort_keys=False, default_flow_style=None),
        setups=len(setups),
    )


def read_table(path: str | Path, case: str | Path | None = None) -> Measurement:
    """Read the measurement in a run table; see ``load_table``.

    Raises:
        TableError: not there, not readable, incomplete or contradictory; names row and reason.
    """
    return load_table(path, case).measurement


def import_table(path: str | Path, case: str | Path | None, target: str | Path) -> RunTable:
    """Make a bag from a run table: its description, its lines, and the table itself.

    Times in the bag count from the start of the run, because a run table has no date.

    Args:
        path: the CSV.
        case: the case file; None for ``case.yaml`` beside the table, if there is one.
        target: the new bag; it appears under its name when it is whole.

    Raises:
        TableError: the table is refused; names file, row and reason.
        BagError: the target exists or cannot be written.
    """
    import stepdiag_ros

    table = load_table(path, case)
    target = Path(target)
    if target.exists():
        raise BagError(f"{target} exists already; a bag is never overwritten")
    if not target.parent.is_dir():
        raise BagError(f"{target}: the folder {target.parent} does not exist")
    description = _description(table, stepdiag_ros.__version__)
    header = RunHeader(
        run_id=description.run_id,
        plan_name=f"imported from {table.path.name}",
        software_version=description.software_version,
        schema_version=description.schema_version,
        middleware="none: imported from a table",
        start_time=0,
        plan=description.plan,
        machine=description.machine,
        facts={"time_origin": "start of the run; the table tells no date"},
        further=_sources(table),
    )
    partial = target.with_name(f".{target.name}.partial")
    partial.unlink(missing_ok=True)
    try:
        with BagWriter(partial, header) as bag:
            _write(bag, topics.RUN_DESCRIPTION, description, 0)
            for line in sorted(table.measurement.lines, key=lambda line: line.end_time):
                message = conversion.from_measured_line(line, description.run_id, own_types().new)
                _write(bag, topics.LINE, message, line.end_time)
        partial.rename(target)
    except OSError as error:
        raise BagWriteError(f"{target} cannot be written: {error.strerror}") from error
    finally:
        partial.unlink(missing_ok=True)
    return table


def _description(table: RunTable, software_version: str) -> Any:
    types = own_types()
    message = types.new(topics.RUN_DESCRIPTION.type_name)
    conversion.set_header(message, 0)
    message.schema_version = types.constant(topics.RUN_DESCRIPTION.type_name, "SCHEMA_VERSION")
    # The same table gives the same identity, so that importing it twice is seen.
    content = hashlib.sha256((table.text + table.case.text).encode()).hexdigest()
    message.run_id = f"imported-{table.path.stem}-{content[:12]}"
    message.software_version = software_version
    message.plan = table.plan_text
    message.machine = table.case.machine_text(FILE_NAME)
    return message


def _sources(table: RunTable) -> tuple[Attachment, ...]:
    name = SOURCE_PREFIX + table.path.name
    sources = [Attachment(name, "text/csv", table.text.encode())]
    if table.case.text:
        sources.append(Attachment.yaml(SOURCE_PREFIX + FILE_NAME, table.case.text))
    return tuple(sources)


def _write(bag: BagWriter, topic: topics.Topic, message: Any, time: int) -> None:
    data = own_types().encode(topic.type_name, message)
    bag.write(topics.absolute(topic), topic.type_name, data, time)


def case_of_run(volume: Volume, machine: dict[str, Any], lines: tuple[MeasuredLine, ...]) -> Case:
    """Return the case that a run's exported table stands beside.

    Args:
        volume: the measured box.
        machine: the machine's YAML, parsed; used are the chain and what an imported table told.
        lines: the exported lines; the reading noise is their standard uncertainty if all share one.
    """
    values = {float(value) for line in lines for value in line.standard_uncertainty}
    known = machine.get("dead_path_m", float("nan"))
    return Case(
        chain="".join(machine.get("chain", "")),
        volume=volume,
        dead_path=float(known),
        reading_noise=values.pop() if len(values) == 1 else float("nan"),
        mirror_on=str(machine.get("mirror_on", "")),
        laser_on=str(machine.get("laser_on", "")),
    )
