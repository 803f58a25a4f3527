"""Reads tables of errors that were measured directly (form: ``metrology.direct``)."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.imports import renishaw_rtl
from stepdiag_ros.bags.imports.source import read_source
from stepdiag_ros.metrology.direct import DirectFile, DirectMeasurement, joined
from stepdiag_ros.metrology.direct_reading import read_direct


def load_direct(paths: Sequence[str | Path]) -> DirectMeasurement | None:
    """Read what was measured directly from one file or more, with its origin.

    Returns:
        None where there are no files.

    Raises:
        TableError: a file cannot be read, or is one of another program.
        ValueError: a table is wrong, or an error is in two files; names file and row.
    """
    parts = []
    for path in paths:
        source = read_source(path)
        if renishaw_rtl.recognises(source):
            raise TableError(
                f"{source.name} is a file of Renishaw's laser software. It does not state the"
                " error, unit or uncertainty of its values: convert it to a table with 'stepdiag"
                f" direct {source.name} --curve E_BX --unit arcsec --uncertainty 0.2'",
                fault="wrong_kind",
            )
        part = read_direct(source.text().text, source.name)
        parts.append(replace(part, files=(DirectFile(source.name, source.sha256, part.names),)))
    return joined(parts) if parts else None
