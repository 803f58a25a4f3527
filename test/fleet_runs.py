"""Runs of several machines in an archive, made up, and what its owner states."""

from datetime import datetime, timedelta, timezone
from pathlib import Path

from archive_runs import digest, made_up

from stepdiag_ros.archive import catalogue
from stepdiag_ros.archive.rows import Rows
from stepdiag_ros.archive.stated import FILE

NOW = datetime(2024, 6, 1, 12, tzinfo=timezone.utc)


def run(number, machine, days, size, **changes):
    """Return the rows of a run, so many days before now, with C0Y of a size and U of 0.2 µm."""
    made = made_up(
        digest(number),
        "part",
        machine=machine,
        start_time=None if days is None else NOW - timedelta(days=days),
        **{"verdict": "CONSISTENT", **changes},
    )
    for figure in made.figures:
        object.__setattr__(figure, "value", size)
    return made


def written(place, *runs):
    """Write runs as the catalogue of an archive."""
    rows = Rows()
    for one in runs:
        for table in ("runs", "figures", "curves"):
            getattr(rows, table).extend(getattr(one, table))
    catalogue.write_part(place, "part", rows)
    return place


def state(place, text):
    """State something on the archive."""
    Path(place.url, FILE).write_text(text)
