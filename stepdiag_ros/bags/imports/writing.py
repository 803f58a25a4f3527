"""Writes what was imported into a bag: its description, its lines or readings, and its sources."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import stepdiag_ros
from stepdiag_ros import topics
from stepdiag_ros.bags.errors import BagError, BagWriteError
from stepdiag_ros.bags.header import Attachment, RunHeader
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.writer import BagWriter
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.metrology.measurement import MeasuredLine, Reading
from stepdiag_ros.topics import Topic

_FRAME = "laser"
"""Of readings, as the interferometer's node has it."""


@dataclass(frozen=True)
class ToWrite:
    """What goes into the bag.

    Attributes:
        run_id: the same for the same source, so that importing it twice is seen.
        plan_name: in words.
        middleware: says that there was none.
        plan: YAML text of the plan.
        machine: YAML text of what is known of the machine; empty if nothing is.
        facts: further facts about the run.
        attachments: the files that it was made from.
        lines: finished lines.
        readings: a stream of readings.
        further: more messages, in order of time: time (ns), topic, message.
        start_time: of the run, ns.
    """

    run_id: str
    plan_name: str
    middleware: str
    plan: str
    machine: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    attachments: tuple[Attachment, ...] = ()
    lines: tuple[MeasuredLine, ...] = ()
    readings: tuple[Reading, ...] = ()
    further: tuple[tuple[int, Topic, Any], ...] = ()
    start_time: int = 0


def write_bag(target: Path, content: ToWrite) -> None:
    """Make a bag; it appears under its name when it is whole.

    Raises:
        BagError: the target exists, its folder does not, or it cannot be written.
    """
    if target.exists():
        raise BagError(
            f"{target} exists already; a bag is never overwritten. Delete it, or name another bag"
            " behind the table",
            fault="exists",
        )
    if not target.parent.is_dir():
        raise BagError(f"{target}: the folder {target.parent} does not exist")
    description = _description(content)
    header = RunHeader(
        run_id=content.run_id,
        plan_name=content.plan_name,
        software_version=description.software_version,
        schema_version=description.schema_version,
        middleware=content.middleware,
        start_time=content.start_time,
        plan=content.plan,
        machine=content.machine,
        facts=content.facts,
        further=content.attachments,
    )
    partial = target.with_name(f".{target.name}.partial")
    try:
        partial.unlink(missing_ok=True)
        with BagWriter(partial, header) as bag:
            _write(bag, topics.RUN_DESCRIPTION, description, content.start_time)
            for line in sorted(content.lines, key=lambda line: line.end_time):
                message = conversion.from_measured_line(line, content.run_id, own_types().new)
                _write(bag, topics.LINE, message, line.end_time)
            further = deque(content.further)
            for reading in content.readings:
                while further and further[0][0] < reading.time:
                    time, topic, message = further.popleft()
                    _write(bag, topic, message, time)
                message = conversion.from_reading(reading, _FRAME, own_types().new)
                _write(bag, topics.READING, message, reading.time)
            for time, topic, message in further:
                _write(bag, topic, message, time)
        partial.rename(target)
    except (OSError, BagWriteError) as error:
        # What the writer says is of a recording, of which the beginning stays.
        cause = error.__cause__ if isinstance(error, BagWriteError) else error
        reason = cause.strerror if isinstance(cause, OSError) else str(error)
        raise BagWriteError(
            f"{target} cannot be written: {reason}", fault="unwritable", where=str(target)
        ) from error
    finally:
        partial.unlink(missing_ok=True)


def _description(content: ToWrite) -> Any:
    types = own_types()
    message = types.new(topics.RUN_DESCRIPTION.type_name)
    set_header(message, content.start_time)
    message.schema_version = types.constant(topics.RUN_DESCRIPTION.type_name, "SCHEMA_VERSION")
    message.run_id = content.run_id
    message.software_version = stepdiag_ros.__version__
    message.plan = content.plan
    message.machine = content.machine
    return message


def _write(bag: BagWriter, topic: Topic, message: Any, time: int) -> None:
    data = own_types().encode(topic.type_name, message)
    bag.write(topics.absolute(topic), topic.type_name, data, time)
