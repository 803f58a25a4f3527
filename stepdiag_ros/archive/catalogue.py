"""The catalogue of an archive: parts of Parquet, written once, and what DuckDB reads from them.

A part is three files of one name, ``runs``, ``figures`` and ``curves``, of which ``runs`` comes
last: the part is there if this file is. Parts never change. Small parts are packed into a larger
one, which names those that it replaces; they stay for a while for those who are reading them. A bag
may be in two parts, since it was evaluated again or two processes have packed at once. Then the
rows of the newest software count, and among these those of the first part by name. Every reader
chooses the same, so that nobody needs to lock anything.
"""

import hashlib
import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import duckdb
import pyarrow
import pyarrow.parquet

from stepdiag_ros import __version__
from stepdiag_ros.archive.columns import TABLES, VERSION, schema
from stepdiag_ros.archive.place import Place
from stepdiag_ros.archive.rows import Rows
from stepdiag_ros.archive.stated import Stated, stated_in
from stepdiag_ros.metrology.refusal import Refusal

FOLDER = "catalogue"
FEW = 100
"""Parts of about one size are packed into one when there are so many. Each row is thus rewritten
once for each power of this number that the archive grows by."""
UNFINISHED = timedelta(days=1)
"""After this time a part without its ``runs`` is not being written any more."""
KEPT = timedelta(minutes=15)
"""A part that was replaced stays for this time, so that who has begun to read can end."""
_MEMORY = "256MB"
"""That packing may use; what is more is sorted on the disk."""
_EACH = "start_time, bag_sha256"
_SORTED = {
    "runs": f"machine, {_EACH}, run_number",
    "figures": f"machine, kind, name, {_EACH}, method",
    "curves": f"machine, name, {_EACH}, method",
}
"""Order of the rows of a part; no two rows are equal in it, so that equal rows are equal bytes."""
_NEWEST = r"regexp_extract_all(software_version, '\d+')::bigint[]"
_DIGITS = 16
_REPLACED = "replaced"
"""Folder of the lists of what parts replace: one text for each part that was packed."""


def part_of_bag(sha256: str) -> str:
    """Return the name of the part that this software makes of a bag."""
    return _part(1, (sha256, __version__))


def write_part(place: Place, part: str, rows: Rows) -> None:
    """Write a part; another process that writes the same writes the same bytes.

    Raises:
        OSError: the place cannot be written.
    """
    with tempfile.TemporaryDirectory() as folder:
        for table in TABLES:
            content = [vars(row) for row in getattr(rows, table)]
            made = pyarrow.Table.from_pylist(content, schema(table))
            pyarrow.parquet.write_table(made, _file(folder, table), compression="zstd")
        _put(place, part, Path(folder))


def _put(place: Place, part: str, folder: Path) -> None:
    for table in reversed(list(TABLES)):
        place.put(_file(folder, table), _name(table, part))


class Catalogue:
    """What an archive's catalogue holds at the moment when it is opened.

    Args:
        place: of the archive.

    Attributes:
        connection: of DuckDB, with the views ``runs``, ``figures`` and ``curves``: the columns of
            ``columns``, with the names of machines and the times that the owner states in place of
            those of the bags. ``machine_stated`` is the name in the bag; ``time`` is when the run
            began, empty where that is not known or in the future.
        parts: names of those that count.
        replaced: part → parts that it replaces and that are still there.
        twice: a bag is in more than one part.
        stated: by the owner.

    Raises:
        ValueError: there is no catalogue of this version but one of another, or the owner's file is
            malformed.
    """

    def __init__(self, place: Place) -> None:
        self.place = place
        self.stated: Stated = stated_in(place)
        files = place.names(f"{FOLDER}/{VERSION}")
        self._files = {table: _parts(files, table) for table in TABLES}
        self._lists = [name for name in files if name.split("/")[2] == _REPLACED]
        there = set(self._files["runs"])
        self.replaced = {
            pack: place.read(name).decode().split()
            for name in self._lists
            if (pack := name.rpartition("/")[2]) in there
        }
        self.parts = sorted(there.difference(*self.replaced.values()))
        if not there:
            _refuse_what_is_no_archive(place)
        self.connection = duckdb.connect()
        self.connection.execute(f"set memory_limit = '{_MEMORY}'")
        if not place.is_local:
            self.connection.register_filesystem(place.file_system)
        self.twice = self._make_rows()
        self._make_views()

    def __enter__(self) -> "Catalogue":
        return self

    def __exit__(self, *_: object) -> None:
        self.connection.close()

    def ask(self, query: str, values: Sequence[Any] = ()) -> list[dict[str, Any]]:
        """Return the rows that a query gives, each as a mapping of its columns.

        Raises:
            ValueError: the query is wrong, or a file is damaged; names what.
        """
        try:
            found = self.connection.execute(query, list(values))
            names = [column[0] for column in found.description or ()]
            return [dict(zip(names, row, strict=True)) for row in found.fetchall()]
        except duckdb.Error as error:
            raise _refusal(error) from None

    def evaluated(self) -> set[str]:
        """Return the SHA-256 of the bags that this version of the software has evaluated."""
        query = "select distinct bag_sha256 from runs where software_version = ?"
        return {row["bag_sha256"] for row in self.ask(query, [__version__])}

    def incomplete_parts(self) -> list[str]:
        """Return the parts that lack one of their files; there are none unless one was removed."""
        whole = set.intersection(*map(set, self._files.values()))
        return [part for part in self.parts if part not in whole]

    def unfinished(self) -> list[str]:
        """Return the files of parts that were never finished, or are being written now."""
        there = set(self._files["runs"])
        names = [_name(table, one) for table in TABLES for one in {*self._files[table]} - there]
        return [*names, *(name for name in self._lists if name.rpartition("/")[2] not in there)]

    def _read(self, table: str, parts: Iterable[str] | None = None) -> str:
        """Return what reads a table in SQL, from parts or from all."""
        there = set(self._files[table])
        chosen = [part for part in (self.parts if parts is None else parts) if part in there]
        names = [_text(self.place.address(_name(table, part))) for part in chosen]
        self.connection.register(f"no_{table}", schema(table).empty_table())
        if not names:
            return f"no_{table}"
        # Parts of an earlier version lack columns that are new.
        read = f"read_parquet([{', '.join(names)}], union_by_name = true)"
        return f"(from {read} union all by name from no_{table})"

    def _make_rows(self) -> bool:
        """Make the views of rows that count; say whether a bag is in more than one part."""
        try:
            for table in TABLES:
                self.connection.execute(f"create view every_{table} as from {self._read(table)}")
            once = "select count(*) = count(distinct hash(bag_sha256)) from every_runs"
            (result,) = self.connection.execute(f"{once} where run_number = 1").fetchone() or (
                True,
            )
        except duckdb.Error as error:
            raise _refusal(error) from None
        counting = (
            "" if result else f"semi join ({_counting('every_runs')}) using (bag_sha256, part)"
        )
        for table in TABLES:
            self.connection.execute(
                f"create view rows_{table} as select * from every_{table} {counting}"
            )
        return not result

    def _make_views(self) -> None:
        """Make the views for users: what counts, with what the owner states."""
        run = self.connection.execute
        run("create table stated_machines (old varchar, new varchar)")
        run("create table stated_times (run varchar, began timestamptz)")
        for table, told in (("machines", self.stated.machines), ("times", self.stated.times)):
            for pair in told.items():
                run(f"insert into stated_{table} values (?, ?)", list(pair))
        machine, time, joins = "machine", "null", ""
        if self.stated.machines:
            machine = "coalesce(by_serial.new, by_name.new, machine)"
            joins += " left join stated_machines by_serial on by_serial.old = serial_number"
            joins += " left join stated_machines by_name on by_name.old = machine"
        if self.stated.times:
            time = "coalesce(by_run.began, by_bag.began)"
            joins += " left join stated_times by_run on by_run.run = run_id"
            joins += " left join stated_times by_bag on by_bag.run = bag_sha256"
        known = "case when start_time <= now() then start_time end"
        for table in TABLES:
            run(
                f"create view {table} as select coalesce({time}, {known}) as time, machine as"
                f" machine_stated, rows_{table}.* replace ({machine} as machine)"
                f" from rows_{table}{joins}"
            )

    def to_pack(self) -> Iterator[list[str]]:
        """Yield parts that are to be packed into one: many of a size, or with a bag of another."""
        twice: set[str] = set()
        if self.twice:
            query = (
                "select distinct part from every_runs semi join (select bag_sha256 from every_runs"
                " group by 1 having count(distinct part) > 1) using (bag_sha256)"
            )
            twice = {row["part"] for row in self.ask(query)}
            yield sorted(twice)
        sizes: dict[int, list[str]] = {}
        for part in self.parts:
            if part not in twice:
                size, level = int(part.partition("-")[0]), 0
                while size >= FEW ** (level + 1):
                    level += 1
                sizes.setdefault(level, []).append(part)
        yield from (parts for parts in sizes.values() if len(parts) >= FEW)

    def pack(self, parts: Sequence[str]) -> str:
        """Write one part with the rows of some, which it replaces; return its name.

        A row is left out only where a row of the same bag among these parts counts in its place.
        Whatever others do meanwhile, one row of each bag stays.

        Raises:
            ValueError: a part is damaged, or another process has packed it meanwhile.
            OSError: the place cannot be written.
        """
        source = self._read("runs", parts)
        counting = _counting(source)
        (bags,) = self.ask(f"select count(*) as number from ({counting})")
        part = _part(bags["number"], parts)
        with tempfile.TemporaryDirectory() as folder:
            self.connection.execute(f"set temp_directory = {_text(folder)}")
            # Each thread has buffers of its own; who packs is to need no more the more there is.
            self.connection.execute("set threads = 1")
            for table, order in _SORTED.items():
                query = (
                    f"select * replace ({_text(part)} as part) from {self._read(table, parts)}"
                    f" semi join ({counting}) using (bag_sha256, part) order by {order}"
                )
                target = _text(str(_file(folder, table)))
                self.ask(f"copy ({query}) to {target} (format parquet, compression zstd)")
            self.connection.execute("reset threads")
            (Path(folder) / _REPLACED).write_text("\n".join(one for one in parts if one != part))
            self.place.put(Path(folder) / _REPLACED, _list(part))
            _put(self.place, part, Path(folder))
        return part


def tidy(place: Place) -> None:
    """Pack what is to be packed, and remove what killed processes have left.

    Raises:
        ValueError: a part is damaged.
        OSError: the place cannot be written.
    """
    with Catalogue(place) as catalogue:
        for parts in catalogue.to_pack():
            try:
                catalogue.pack(parts)
            except Refusal:
                if all(place.exists(_name("runs", part)) for part in parts):
                    raise
                return  # Another process has packed and removed them.
        for name in (*catalogue.unfinished(), *place.leftovers()):
            if _since(place, name) > UNFINISHED:
                place.remove(name)
        for pack, parts in catalogue.replaced.items():
            if _since(place, _name("runs", pack)) > KEPT:
                for table in TABLES:
                    for part in parts:
                        place.remove(_name(table, part))
                place.remove(_list(pack))


def _since(place: Place, name: str) -> timedelta:
    """Return how long ago a file was written; no time at all if it is gone."""
    try:
        return datetime.now(timezone.utc) - place.written(name)
    except FileNotFoundError:
        return timedelta()


def _counting(source: str) -> str:
    """Return the query for bag and part of the rows that count among those of a source."""
    return (
        "select bag_sha256, part from (select distinct bag_sha256, part, software_version from"
        f" {source}) qualify row_number() over (partition by bag_sha256 order by {_NEWEST} desc,"
        " part) = 1"
    )


def _refuse_what_is_no_archive(place: Place) -> None:
    versions = {name.split("/")[1] for name in place.names(FOLDER)} - {str(VERSION)}
    if versions:
        raise Refusal(
            f"{place.url} has a catalogue of version {', '.join(sorted(versions))}, and this"
            f" program reads version {VERSION}: 'stepdiag archive update {place.url}' makes one of"
            " the bags, and leaves the other to those who read it",
            fault="mismatch",
            aspect="catalogue",
        )
    raise Refusal(
        f"{place.url} has no catalogue: 'stepdiag archive add {place.url} BAG' begins one,"
        " 'stepdiag archive update' makes one of the bags that are there",
        fault="missing",
        aspect="catalogue",
    )


def _refusal(error: Exception) -> Refusal:
    words = (str(error).splitlines() or [""])[0]
    if isinstance(error, duckdb.IOException):
        words += "; see 'stepdiag archive verify'"
    return Refusal(f"the catalogue cannot answer: {words}", fault="failed")


def _part(bags: int, made_of: Sequence[str]) -> str:
    told = "\n".join((str(VERSION), *sorted(made_of)))
    return f"{bags}-{hashlib.sha256(told.encode()).hexdigest()[:_DIGITS]}"


def _parts(files: Iterable[str], table: str) -> list[str]:
    start, end = _name(table, "").split(".")
    return [
        name[len(start) : -len(end) - 1]
        for name in files
        if name.startswith(start) and name.endswith(f".{end}")
    ]


def _name(table: str, part: str) -> str:
    return f"{FOLDER}/{VERSION}/{table}/{part}.parquet"


def _list(part: str) -> str:
    return f"{FOLDER}/{VERSION}/{_REPLACED}/{part}"


def _file(folder: str | os.PathLike[str], table: str) -> Path:
    return Path(folder) / f"{table}.parquet"


def _text(text: str) -> str:
    """Return a text as SQL has it."""
    return "'" + text.replace("'", "''") + "'"
