"""Run tables: read one, make a bag from one. The way back is ``table_writing.run_table_of``.

A run table is CSV with one row a stop (``table_rows.COLUMNS``); beside it may stand a ``case.yaml``
with what is known of the machine and the laser. A table is taken whole or refused, with the row and
the reason.
"""

import hashlib
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

from stepdiag_ros.bags.case import FILE_NAME, Case, read_case
from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.header import FACT, Attachment
from stepdiag_ros.bags.imports.source import PREFIX
from stepdiag_ros.bags.imports.writing import ToWrite, write_bag
from stepdiag_ros.bags.table_plan import planned_lines
from stepdiag_ros.bags.table_rows import parse_rows, read_text
from stepdiag_ros.metrology.measurement import Measurement


@dataclass(frozen=True)
class RunTable:
    """A run table that was read and checked.

    Attributes:
        path: of the CSV.
        text: of the CSV.
        data: its bytes, as they are in the file.
        case: contents of the case file.
        measurement: box and lines; a line's index is its place in the plan.
        plan_text: YAML of the plan: as far as the case file does not state it, one that measures
            these lines.
        setups: number of setups.
    """

    path: Path
    text: str
    data: bytes
    case: Case
    measurement: Measurement
    plan_text: str
    setups: int

    @property
    def stops(self) -> int:
        """Return the number of rows."""
        return sum(len(line.time) for line in self.measurement.lines)


def load_table(
    path: str | Path, case: str | Path | None = None, overrun: float | None = None
) -> RunTable:
    """Read a run table with its case file.

    Args:
        path: the CSV.
        case: the case file; by default ``case.yaml`` beside the table, if there is one.
        overrun: how far beyond its first stop each line but a step diagonal was begun, m; None
            for what the case file says, else 0. A column ``overrun_m`` of the table says it itself.

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
    if overrun is not None:
        if rows[0].told.overrun is not None:
            raise TableError(
                f"{path} states the overrun of every pass itself (column 'overrun_m'). Leave out"
                " --overrun",
                fault="too_many",
            )
        known = {"overrun_m": overrun} if isfinite(overrun) else {}
        told = replace(told, plan={**told.plan, **known})
    begun = told.overrun if overrun is None else overrun
    found = planned_lines(f"imported from {path.name}", rows, told, begun, str(path))
    return RunTable(
        path=path,
        text=text,
        data=path.read_bytes(),
        case=told,
        measurement=Measurement(found.plan.volume, found.lines, told.chain, told.plausible),
        plan_text=found.text,
        setups=found.setups,
    )


def read_table(path: str | Path, case: str | Path | None = None) -> Measurement:
    """Read the measurement in a run table; see ``load_table``.

    Raises:
        TableError: not there, not readable, incomplete or contradictory; names row and reason.
    """
    return load_table(path, case).measurement


def import_table(
    path: str | Path,
    case: str | Path | None,
    target: str | Path,
    overrun: float | None = None,
) -> RunTable:
    """Make a bag from a run table: its description, its lines, and the table itself.

    Times in the bag count from the start of the run, because a run table has no date.

    Args:
        path: the CSV.
        case: the case file; None for ``case.yaml`` beside the table, if there is one.
        target: the new bag; it appears under its name when it is whole.
        overrun: as in ``load_table``.

    Raises:
        TableError: the table is refused; names file, row and reason.
        BagError: the target exists or cannot be written.
    """
    table = load_table(path, case, overrun)
    # The same table gives the same identity, so that importing it twice is seen.
    content = hashlib.sha256((table.text + table.case.text).encode()).hexdigest()
    write_bag(
        Path(target),
        ToWrite(
            run_id=f"imported-{table.path.stem}-{content[:12]}",
            plan_name=f"imported from {table.path.name}",
            middleware="none: imported from a table",
            plan=table.plan_text,
            machine=table.case.machine_text(FILE_NAME),
            facts={
                "time_origin": "start of the run; the table has no date",
                **{f"{FACT}{name}": text for name, text in table.case.facts.items()},
                "source_file": table.path.name,
                "source_format": "run table",
                "source_sha256": hashlib.sha256(table.data).hexdigest(),
            },
            attachments=_sources(table),
            lines=table.measurement.lines,
        ),
    )
    return table


def _sources(table: RunTable) -> tuple[Attachment, ...]:
    name = PREFIX + table.path.name
    sources = [Attachment(name, "text/csv", table.data)]
    if table.case.text:
        sources.append(Attachment.yaml(PREFIX + FILE_NAME, table.case.text))
    return tuple(sources)
