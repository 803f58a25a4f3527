"""What the owner of an archive states of its runs: ``archive.yaml``, beside the bags."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from math import inf, nan
from typing import Any

from stepdiag_ros.archive.place import Place
from stepdiag_ros.metrology.geometry import (
    AXES,
    BODY_DIAGONALS,
    ROTATIONS,
    SQUARENESS,
    TRANSLATIONS,
)
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.text.intake import parse_yaml

FILE = "archive.yaml"
LARGEST = "largest in volume"
FIGURES = {
    LARGEST: "m",
    **dict.fromkeys(SQUARENESS, "rad"),
    **{f"positioning E_{axis}{axis}": "m" for axis in AXES},
    **{f"straightness {curve}": "m" for curve in TRANSLATIONS if curve[2] != curve[3]},
    **{f"{what} {curve}": "rad" for curve in ROTATIONS for what in ("angular", "angular-shape")},
    **{f"diagonal {line}": "m" for line in BODY_DIAGONALS},
}
"""Figure that runs have without a diagnosis → its unit."""
_LARGEST_TOLERANCE = {"m": 5e-3, "rad": 1e-2}
"""By unit; larger ones are in µm or µrad."""
_LARGEST_SCALE = 1e-3


@dataclass(frozen=True)
class Stated:
    """What bags do not know, or know wrongly.

    Attributes:
        machines: name or serial number that bags state → name under which the machine is listed.
        times: identity of a run, or SHA-256 of its bag → when it really began.
        tolerances: machine, or empty for all → figure → largest magnitude that it may have, in its
            unit.
        scales: serial number or name of an instrument → relative standard uncertainty of the scale
            that its runs share.
    """

    machines: Mapping[str, str] = field(default_factory=dict)
    times: Mapping[str, datetime] = field(default_factory=dict)
    tolerances: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)


def stated_in(place: Place) -> Stated:
    """Return what the file of an archive states; nothing where there is no file.

    Raises:
        ValueError: the file cannot be read, or an entry is not what it must be; names it.
    """
    where = f"{place.url}/{FILE}"
    if not place.exists(FILE):
        return Stated()
    try:
        told = parse_yaml(place.read(FILE).decode(), where)
    except UnicodeDecodeError as error:
        raise Refusal(f"{where} is not a text: {error}", fault="malformed", where=where) from None
    known = Stated.__dataclass_fields__
    if not isinstance(told, dict) or not {*told} <= {*known}:
        raise Refusal(f"{where}: give {' and '.join(known)}, each a table", fault="unknown")
    machines, times, tolerances, scales = (
        _table(told.get(name) or {}, name, where) for name in known
    )
    for old, new in machines.items():
        if not isinstance(new, str) or not new or new in machines:
            raise Refusal(
                f"{where}: machines: '{old}' must have a name that is not renamed itself, not"
                f" '{new}'",
                fault="malformed",
                about=old,
                where=where,
            )
    limits: dict[str, dict[str, float]] = {"": {}}
    for name, limit in tolerances.items():
        of_one = isinstance(limit, dict)
        for figure, size in _table(limit, name, where).items() if of_one else [(name, limit)]:
            limits.setdefault(name if of_one else "", {})[figure] = _size(
                size, "tolerances", figure, where, FIGURES.get(figure, "")
            )
    return Stated(
        machines,
        {run: _time(run, time, where) for run, time in times.items()},
        limits,
        {name: _size(size, "scales", name, where) for name, size in scales.items()},
    )


def _size(told: Any, table: str, about: str, where: str, unit: str = "") -> float:
    try:
        size = nan if isinstance(told, bool) else float(told)
    except (TypeError, ValueError):
        size = nan
    if not 0.0 < size < inf:
        raise Refusal(
            f"{where}: {table}: '{about}' needs a number above 0 in SI units, such as 2.0e-5, not"
            f" '{told}'",
            fault="malformed",
            about=about,
            where=where,
        )
    most = _LARGEST_SCALE if table == "scales" else _LARGEST_TOLERANCE.get(unit, inf)
    if size > most:
        meaning = f"in {unit}" if unit else "as a relative standard uncertainty"
        raise Refusal(
            f"{where}: {table}: '{about}' is {told}, expected at most {most:g}. State it {meaning},"
            " such as 2.5e-5 for 25 µm, 25 µrad or 25 ppm",
            fault="out_of_range",
            about=about,
            where=where,
        )
    return size


def _table(told: Any, name: str, where: str) -> dict[str, Any]:
    if not isinstance(told, dict):
        raise Refusal(f"{where}: {name} is not a table", fault="malformed", about=name, where=where)
    return {str(key): value for key, value in told.items()}


def _time(run: str, told: Any, where: str) -> datetime:
    try:
        time = told if isinstance(told, datetime) else datetime.fromisoformat(str(told))
    except ValueError:
        time = None
    if time is None or time.tzinfo is None:
        raise Refusal(
            f"{where}: times: '{run}' needs a date and a time with its zone, such as"
            f" 2026-03-01T10:00:00+00:00, not '{told}'",
            fault="malformed",
            about=run,
            where=where,
        )
    return time
