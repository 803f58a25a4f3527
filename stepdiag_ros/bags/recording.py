"""A recording of an instrument that was not connected to the control: readings over time.

It is any file that ``imports`` reads as a stream of readings, or a bag that holds one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isnan
from pathlib import Path

from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.folder import SUFFIXES, open_bag
from stepdiag_ros.bags.header import Attachment
from stepdiag_ros.bags.imports.imported import ImportOptions
from stepdiag_ros.bags.imports.registry import read_file
from stepdiag_ros.bags.imports.source import PREFIX
from stepdiag_ros.bags.run import load_run
from stepdiag_ros.metrology.air.compensator import Compensator
from stepdiag_ros.metrology.measurement import Reading

BETWEEN = 1_000_000_000
"""ns that are put between two recordings whose own times do not follow one another."""


@dataclass(frozen=True)
class Recording:
    """What a file of readings over time holds.

    Attributes:
        path: of the file.
        readings: in order of time.
        sources: the file, byte for byte; of a bag, the files that it was made from.
        machine_text: YAML of what it states about the machine; empty if nothing.
        facts: what else it states, as texts.
    """

    path: Path
    readings: tuple[Reading, ...]
    sources: tuple[Attachment, ...]
    machine_text: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)


def read_recording(path: Path, mapping: str, plan_text: str) -> Recording:
    """Read a recording.

    Args:
        path: a bag, or a file of any format that is a stream of readings.
        mapping: file that says what the columns are; empty without one.
        plan_text: YAML of the plan.

    Raises:
        ValueError: it cannot be read, or holds no stream of readings; one sentence.
    """
    if path.is_dir() or path.name.endswith(SUFFIXES):
        run = load_run(path)
        with open_bag(path) as bag:
            sources = tuple(one for one in bag.attachments if one.name.startswith(PREFIX))
        found = Recording(path, tuple(run.readings()), sources, run.machine_text)
    else:
        source, made = read_file(path, ImportOptions(mapping=mapping, plan=plan_text))
        further = (
            Attachment.yaml(PREFIX + name, text) for name, text in sorted(made.further.items())
        )
        found = Recording(
            path,
            made.readings,
            (source.attachment(), *further),
            made.machine_text,
            {**made.facts, **{f"remark {n}": text for n, text in enumerate(made.remarks, 1)}},
        )
    if not found.readings:
        raise BagError(
            f"{path} has no stream of readings. Import a table of stops with: stepdiag import"
        )
    if _nothing_compensated(found.readings):
        found = replace(
            found,
            readings=_compensated(found.readings),
            facts={
                **found.facts,
                "compensated": "for the air data in the file, without a dead path",
            },
        )
    if _nothing_compensated(found.readings):
        raise BagError(
            f"{path}: the readings are not compensated for the air, and the air is unknown. State"
            " in the mapping file that the instrument compensates ('compensated: true'), or give"
            " the air ('environment': air_temperature_degC, air_pressure_Pa, relative_humidity)"
        )
    return found


def _nothing_compensated(readings: Sequence[Reading]) -> bool:
    return all(isnan(reading.compensated_displacement) for reading in readings)


def _compensated(readings: Sequence[Reading]) -> tuple[Reading, ...]:
    """Compensate readings for the air data that they contain; NaN without air data.

    How long the way from the laser to the mirror is, nobody has said: the dead path is taken as
    zero. It matters only where the air changes while a line is measured.
    """
    compensator = Compensator("own")
    return tuple(compensator.reading(reading, reading.environment) for reading in readings)


def one_after_another(recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """Return recordings whose times follow one another; those that overlap are moved."""
    placed: list[Recording] = []
    for recording in recordings:
        first = recording.readings[0].time
        last = placed[-1].readings[-1].time if placed else first - 1
        if first <= last:
            shift = last + BETWEEN - first
            moved = tuple(one._replace(time=one.time + shift) for one in recording.readings)
            recording = replace(recording, readings=moved)
        placed.append(recording)
    return tuple(placed)
