"""Which formats there are, which of them a file has, and a bag from it.

A format is a module here with ``NAME``, ``recognises(source)`` by content and ``read(source,
options)``; what has no such description of its own is read by ``mapped_table`` with a mapping file.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from stepdiag_ros.bags.case import Case
from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.header import FACT, Attachment
from stepdiag_ros.bags.imports import mapped_table, plain_axis_table, renishaw_rtl, tracker_lines
from stepdiag_ros.bags.imports.imported import Imported, ImportOptions
from stepdiag_ros.bags.imports.source import PREFIX, SourceFile, read_source
from stepdiag_ros.bags.imports.together import together
from stepdiag_ros.bags.imports.writing import ToWrite, write_bag
from stepdiag_ros.bags.table_rows import COLUMNS
from stepdiag_ros.configuration import available

_PLACED = (renishaw_rtl.NAME, plain_axis_table.NAME, mapped_table.NAME)
_SERVES = {
    **dict.fromkeys(("axis", "box", "standing", "directions"), _PLACED),
    "chain": (tracker_lines.NAME,),
    "decimal": (renishaw_rtl.NAME,),
    "encoding": (renishaw_rtl.NAME, tracker_lines.NAME, mapped_table.NAME),
    "plan": (mapped_table.NAME,),
}
"""Option of the user → formats that it serves."""
_IN_MAPPING = {"chain": "'chain'", "decimal": "'decimal' under 'text'"}
"""Option of the user → key of a mapping file in its place."""
_ENOUGH_COLUMNS = 4
"""Of a run table's, after which a table is taken for one that may lack others."""


class Format(NamedTuple):
    """A format: its name, whether a file has it, and how it is read."""

    name: str
    recognises: Callable[[SourceFile], bool]
    read: Callable[[SourceFile, ImportOptions], Imported]


FORMATS = (
    Format(renishaw_rtl.NAME, renishaw_rtl.recognises, renishaw_rtl.read),
    Format(tracker_lines.NAME, tracker_lines.recognises, tracker_lines.read),
    Format(plain_axis_table.NAME, plain_axis_table.recognises, plain_axis_table.read),
)


def is_run_table(source: SourceFile) -> bool:
    """Say whether the first line of a file names columns of a run table (``bags.table``)."""
    first = source.data[:2000].lstrip().splitlines()[0].decode("utf-8", errors="replace")
    names = {name.strip(' "\ufeff') for name in first.replace(";", ",").split(",")}
    many = len(names.intersection(COLUMNS)) >= _ENOUGH_COLUMNS
    return many and not tracker_lines.recognises(source)


def recognised(source: SourceFile) -> Format | None:
    """Return the format that a file has; None where it has none of ``FORMATS``."""
    return next((found for found in FORMATS if found.recognises(source)), None)


def _refuse_idle_options(source: SourceFile, name: str, said: ImportOptions) -> None:
    """Refuse what the user states and a format has no use for."""
    for option, serves in _SERVES.items():
        if name in serves or getattr(said, option) == getattr(ImportOptions, option):
            continue
        key = _IN_MAPPING.get(option) if said.mapping else None
        raise TableError(
            f"{source.name}: --{option} has no effect on a {name}. "
            + (f"State {key} in the mapping file" if key else "Leave it out"),
            fault="mismatch",
            about=f"--{option}",
            where=source.name,
        )


def read_file(
    path: str | Path, options: ImportOptions | None = None
) -> tuple[SourceFile, Imported]:
    """Read a file of any format.

    Args:
        path: the file.
        options: what the user says about it.

    Raises:
        TableError: it is of no known format, or refused; names file, row and reason.
    """
    source = read_source(path)
    said = options or ImportOptions()
    if said.mapping:
        _refuse_idle_options(source, mapped_table.NAME, said)
        return source, mapped_table.read(source, said)
    found = recognised(source)
    if found is not None:
        _refuse_idle_options(source, found.name, said)
        return source, found.read(source, said)
    source.text(said.encoding)  # says it better where the file is not text at all
    raise TableError(
        f"{source.name} has no known format ({', '.join(one.name for one in FORMATS)}, run"
        " table); describe its columns in a mapping file: --mapping FILE, or --mapping with one of "
        + ", ".join(available("imports")),
        fault="unknown",
        aspect="format",
    )


def import_file(path: str | Path, target: str | Path, options: ImportOptions) -> Imported:
    """Make a bag from one file; see ``import_files``."""
    return import_files([path], target, [options])


def import_files(
    paths: Sequence[str | Path], target: str | Path, options: Sequence[ImportOptions]
) -> Imported:
    """Make a bag from a file, or from several that are one measurement; they go into it as are.

    Times in the bag count from the start of the measurement, as far as the file states them.

    Args:
        paths: the files; several are tests of one line each.
        target: the new bag; it appears under its name when it is whole.
        options: what the user says about each file.

    Raises:
        TableError: a file is refused, or they do not fit together; names file, row and reason.
        BagError: the target exists or cannot be written.
    """
    read = [read_file(path, said) for path, said in zip(paths, options, strict=True)]
    sources = [source for source, _ in read]
    _check_different(sources)
    made = together([(source.name, one) for source, one in read])
    # The same files, read in the same way, give the same identity.
    content = hashlib.sha256(b"".join(source.data for source in sources))
    content.update(repr((made.plan_text, *sorted(made.further.items()))).encode())
    further = tuple(
        Attachment.yaml(PREFIX + name, text) for name, text in sorted(made.further.items())
    )
    names = ", ".join(source.path.name for source in sources)
    write_bag(
        Path(target),
        ToWrite(
            run_id=f"imported-{sources[0].path.stem}-{content.hexdigest()[:12]}",
            plan_name=f"imported from {names}",
            middleware=f"none: imported ({made.format})",
            plan=made.plan_text,
            machine=made.machine_text or _machine_text(made.facts),
            facts={
                "time_origin": "start of the measurement, as far as the file states times",
                **{f"{FACT}{name}": text for name, text in made.facts.items()},
                **{f"remark {n}": text for n, text in enumerate(made.remarks, start=1)},
                "source_file": names,
                "source_format": made.format,
                "source_sha256": ", ".join(source.sha256 for source in sources),
            },
            attachments=(*(source.attachment() for source in sources), *further),
            lines=made.lines,
            readings=made.readings,
        ),
    )
    return made


def _machine_text(facts: Mapping[str, str]) -> str:
    return Case(facts=facts).machine_text("") if "machine" in facts else ""


def _check_different(sources: Sequence[SourceFile]) -> None:
    """Refuse files that are there twice, or that the bag could not keep apart.

    Raises:
        TableError: names both.
    """
    for place, source in enumerate(sources):
        for other in sources[:place]:
            if source.data == other.data:
                raise TableError(f"{other.name} and {source.name} are the same file, byte for byte")
            if source.path.name == other.path.name:
                raise TableError(
                    f"{other.name} and {source.name} have the same name, which the bag would"
                    " store twice. Rename one"
                )
