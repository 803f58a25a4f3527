"""Reads the text files of Renishaw's laser software with linear tests (``.rtl``).

Renishaw has published no description of this format that we know of. What is read here is what
public programs of others read and write: one from the maker of a machine control (sections, counts,
``run target deviation`` rows), three that make compensation tables from it (targets in mm,
deviations in µm, every second run in the opposite order), one that keeps a sample of the section
ENVIRONMENT in its comments (values at start and end, kPa, ``-10`` for a sensor that is not there,
expansion coefficient in ppm/K), and one that writes such files. They agree on:

    HEADER::       File type, Owner, Version no
    TARGET DATA::  Filetype, Target-count, Targets: the positions, in several lines; Flags
    USER-TEXT::    Machine, Serial No, Date, By, Axis, Location, TITLE
    RUNS::         Run-count
    DEVIATIONS::   Run Target Data: rows of run number, target number, deviation
    EQUIPMENT::    (in files of angles; kept as text)
    ENVIRONMENT::  Air temp, Air press, Air humid, Mat temp 1 to 3, Env factor, Exp coeff, Date Time
    EOF::

Not known: what Flags and Final Data mean, the third number behind values of the environment except
in that sample, and whether deviations are already reduced to 20 °C by Exp coeff; all are kept as
text. Nothing is known of ``.rtl2`` but its name: a file that begins like this one is read, whatever
its name says, and any other is refused.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from stepdiag_ros.bags.errors import TableError
from stepdiag_ros.bags.imports.axis_test import AxisRow, axis_name, axis_test
from stepdiag_ros.bags.imports.imported import Imported, ImportOptions
from stepdiag_ros.bags.imports.source import SourceFile, SourceText, number_in, whole_in
from stepdiag_ros.bags.table_rows import refusal
from stepdiag_ros.metrology.measurement import Environment

NAME = "Renishaw .rtl"
_SECTION = re.compile(r"([A-Z][A-Z0-9 \-]*?) *:: *")
_ENTRY = re.compile(r"([^:]+?)\s*:\s*(.*)")
_KNOWN = (
    "HEADER",
    "TARGET DATA",
    "USER-TEXT",
    "RUNS",
    "DEVIATIONS",
    "EQUIPMENT",
    "ENVIRONMENT",
    "EOF",
)
# Suffixes of the same software's other tests, which have another quantity in the same places.
_OTHER_TESTS = {
    ".rta": "angles",
    ".rts": "straightness",
    ".rtf": "flatness",
    ".rtx": "a rotary axis",
}
_DIRECT = ("angles", "straightness")
_FACTS = {
    "Owner": "software",
    "Version no": "software_version_of_file",
    "Machine": "machine",
    "Serial No": "machine_serial_number",
    "Date": "test_date",
    "By": "operator",
    "Axis": "axis_as_told",
    "Location": "location",
    "TITLE": "title",
}
_NO_SENSOR = -10.0
_MILLI, MICRO = 1e-3, 1e-6


@dataclass
class RtlContent:
    """What was found in the sections.

    Attributes:
        entries: of each section, by their keys: line of the file and text.
        targets: mm.
        rows: of the deviations: line of the file and text.
        unknown: names of sections that are not understood.
        ended: whether EOF:: was there.
        last_row: last line of the file that is not empty.
    """

    entries: dict[str, dict[str, tuple[int, str]]] = field(default_factory=dict)
    targets: list[float] = field(default_factory=list)
    rows: list[tuple[int, str]] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)
    ended: bool = False
    last_row: int = 0

    def entry(self, section: str, key: str) -> tuple[int, str]:
        """Return the line and the text of an entry; 0 and an empty text if it is not there."""
        for name, found in self.entries.get(section, {}).items():
            if name.lower() == key.lower():
                return found
        return 0, ""


def recognises(source: SourceFile) -> bool:
    """Say whether a file begins as this format does, in any encoding that has ASCII in it."""
    begin = source.data[:200].replace(b"\0", b"").lstrip(b"\xff\xfe\xef\xbb\xbf \t\r\n")
    return begin.upper().startswith(b"HEADER::")


def read(source: SourceFile, options: ImportOptions) -> Imported:
    """Read a test of an axis.

    Raises:
        TableError: the file is cut off, contradicts itself, holds no linear test, or something in
            it is unknown; names file and row.
    """
    other = _OTHER_TESTS.get(source.path.suffix.lower())
    if other:
        raise TableError(
            f"{source.name} is, by its name, a test of {other}; only linear positioning (.rtl) is"
            " a measurement of its own"
            + (
                "; 'stepdiag direct' makes a table of it that 'stepdiag solve --direct' uses"
                if other in _DIRECT
                else ""
            ),
            fault="wrong_kind",
            aspect="quantity",
        )
    text = source.text(options.encoding)
    content, rows = deviations(text, options.decimal)
    axis = axis_name(content.entry("USER-TEXT", "Axis")[1], options, text.name)
    remarks = [*text.remarks]
    if not content.ended:
        remarks.append("the file does not end with EOF::, but all its runs are complete")
    for name in content.unknown:
        remarks.append(f"the section {name}:: is unknown and was left out")
    environment, facts, said = _environment(content, options.decimal)
    remarks.extend(said)
    for section in ("HEADER", "USER-TEXT"):
        for key, name in _FACTS.items():
            told = content.entry(section, key)[1]
            if told:
                facts[name] = told
    flags = content.entry("TARGET DATA", "Flags")[1]
    if flags:
        facts["flags"] = flags
    for key, (_, told) in content.entries.get("EQUIPMENT", {}).items():
        if told:
            facts[f"equipment: {key}"] = told
    return axis_test(text.name, NAME, axis, rows, options, environment, facts, remarks)


def deviations(text: SourceText, decimal: str) -> tuple[RtlContent, list[AxisRow]]:
    """Return the sections of a file and its deviations, those in µm as metres.

    Raises:
        TableError: the file is cut off or contradicts itself; names file and row.
    """
    content = _sections(text, decimal)
    return content, _rows(text.name, content, decimal)


def _sections(text: SourceText, decimal: str) -> RtlContent:
    content = RtlContent()
    section, listing = "", False
    for number, line in text.lines():
        plain = line.strip()
        if not plain:
            continue
        content.last_row = number
        if content.ended:
            raise refusal(text.name, number, "text follows EOF::", fault="too_many")
        heading = _SECTION.fullmatch(plain)
        if heading:
            section, listing = heading[1].upper(), False
            if section in content.entries:
                raise refusal(
                    text.name, number, f"the section {section}:: appears twice", fault="twice"
                )
            content.entries[section] = {}
            if section not in _KNOWN:
                content.unknown.append(section)
            content.ended = section == "EOF"
            continue
        entry = _ENTRY.fullmatch(plain)
        if entry and not plain[0].isdigit():
            key = entry[1]
            listing = (section, key.lower()) in (
                ("TARGET DATA", "targets"),
                ("DEVIATIONS", "run target data"),
            )
            if listing and entry[2]:
                raise refusal(text.name, number, f"'{entry[2]}' follows '{key} :'")
            if key in content.entries[section]:
                raise refusal(text.name, number, f"'{key}' is there twice in {section}::")
            content.entries[section][key] = (number, entry[2])
        elif listing and section == "TARGET DATA":
            for word in plain.split():
                content.targets.append(number_in(word, text.name, number, "a target", decimal))
        elif listing:
            content.rows.append((number, plain))
        elif section in ("TARGET DATA", "RUNS", "DEVIATIONS"):
            raise refusal(
                text.name,
                number,
                f"'{plain[:40]}' in {section}:: is unknown",
                fault="malformed",
            )
    return content


def _rows(source: str, content: RtlContent, decimal: str) -> list[AxisRow]:
    for section in ("TARGET DATA", "DEVIATIONS"):
        if section not in content.entries:
            raise refusal(
                source,
                content.last_row,
                f"the file ends without the section {section}::; the file may be cut off",
            )
    targets = content.targets
    row, told = content.entry("TARGET DATA", "Target-count")
    if row and whole_in(told, source, row, "Target-count") != len(targets):
        raise refusal(
            source,
            row,
            f"Target-count is {told}, but {len(targets)} targets follow; the file may be cut off",
            fault="mismatch",
        )
    made = []
    for number, plain in content.rows:
        cells = plain.split()
        if len(cells) != 3:
            raise refusal(
                source,
                number,
                f"'{plain[:40]}' does not state a run, a target and a deviation; the file may be"
                " cut off",
                fault="malformed",
            )
        run = whole_in(cells[0], source, number, "the run", 1)
        target = whole_in(cells[1], source, number, "the target", 1)
        if target > len(targets):
            raise refusal(
                source,
                number,
                f"there is no target {target}, only {len(targets)}",
                fault="out_of_range",
            )
        deviation = number_in(cells[2], source, number, "the deviation", decimal)
        made.append(AxisRow(number, run, _MILLI * targets[target - 1], MICRO * deviation))
    measured = {one.target for one in made}
    for place, position in enumerate(targets, start=1):
        if _MILLI * position not in measured:
            raise refusal(
                source,
                content.last_row,
                f"no run has a deviation at target {place} ({position:g} mm); the file may be cut"
                " off",
            )
    row, told = content.entry("RUNS", "Run-count")
    runs = len({one.run for one in made})
    if row and whole_in(told, source, row, "Run-count") != runs:
        raise refusal(
            source,
            content.last_row,
            f"Run-count in row {row} is {told}, but the file has {runs} runs; the file may be cut"
            " off",
            fault="mismatch",
        )
    return made


def _environment(
    content: RtlContent, decimal: str
) -> tuple[Environment, dict[str, str], list[str]]:
    """Return means of start and end in SI units, all entries as text, and what is not known."""
    facts: dict[str, str] = {}
    remarks: list[str] = []
    means: dict[str, float] = {}
    materials = []
    for key, (number, told) in content.entries.get("ENVIRONMENT", {}).items():
        if told:
            facts[f"environment: {key}"] = told
        for name, kind, low, high in _quantities(key.lower()):
            values = _start_and_end(told, decimal, kind)
            if kind == "material" and values and _NO_SENSOR in values:
                continue
            if not values or not all(low <= value <= high for value in values):
                if told:
                    remarks.append(
                        f"'{key} : {told}' in row {number} is unknown (unit?); it counts as"
                        " not known"
                    )
            elif kind == "material":
                materials.append(sum(values) / 2)
            else:
                means[name] = sum(values) / 2
    if "expansion" in means:
        facts["expansion_coefficient_per_K"] = f"{1e-6 * means.pop('expansion'):.9g}"
    # The file does not say how far its deviations are reduced by these; unknown is not "no".
    facts["compensation_state"] = "unknown: the file does not say what its deviations include"
    environment = Environment(
        air_temperature=means.get("air_temperature", float("nan")),
        air_pressure=1e3 * means.get("air_pressure", float("nan")),
        relative_humidity=means.get("relative_humidity", float("nan")) / 100.0,
        material_temperature=sum(materials) / len(materials) if materials else float("nan"),
    )
    return environment, facts, remarks


def _quantities(key: str) -> Iterator[tuple[str, str, float, float]]:
    """Yield name, kind and the limits of what an entry can be: °C, kPa, per cent, ppm/K."""
    if key == "air temp":
        yield "air_temperature", "0", -20.0, 60.0
    elif key == "air press":
        yield "air_pressure", "1", 50.0, 120.0
    elif key == "air humid":
        yield "relative_humidity", "", 0.0, 100.0
    elif key.startswith("mat temp"):
        yield "material_temperature", "material", -20.0, 60.0
    elif key == "exp coeff":
        yield "expansion", "0", -5.0, 50.0


def _start_and_end(told: str, decimal: str, kind: str) -> tuple[float, float] | tuple[()]:
    """Return the two numbers of an entry; nothing where a number behind them is not as known."""
    cells = told.split()
    known = {"material": "0"}.get(kind, kind)
    if len(cells) not in (2, 3) or (len(cells) == 3 and cells[2] != (known or cells[2])):
        return ()
    try:
        first, last = (number_in(cell, "", 0, "", decimal) for cell in cells[:2])
    except TableError:
        return ()
    return first, last
