"""A recorded run as data classes: everything that a bag says about it, without any ROS client."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from stepdiag_ros import topics
from stepdiag_ros.bags.bag import Bag
from stepdiag_ros.bags.case import SIMULATED_CELL
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.folder import open_bag
from stepdiag_ros.bags.readings import ReadingBatch, RunReadings
from stepdiag_ros.bags.runs import FoundRun, choose_run, messages_of
from stepdiag_ros.bags.tally import Flaw
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.bags.wholeness import Recorded, numbers_of_readings
from stepdiag_ros.configuration import chain_from_text, plan_from_text, plausible_from_text
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.diagnosis import to_diagnosis
from stepdiag_ros.messages.fields import to_nanoseconds
from stepdiag_ros.messages.positioning import to_positioning_test
from stepdiag_ros.messages.target import target_of
from stepdiag_ros.messages.volumetric import to_volumetric_errors
from stepdiag_ros.metrology.air.recompensation import SensorValue
from stepdiag_ros.metrology.checking import UNKNOWN
from stepdiag_ros.metrology.discrepancy.summary import DiagnosisSummary
from stepdiag_ros.metrology.measurement import (
    Arrival,
    BlockDisplacement,
    MeasuredLine,
    Measurement,
    Reading,
    SettledStop,
    StopCommand,
    latest_attempts,
)
from stepdiag_ros.metrology.plan import Plan, Volume
from stepdiag_ros.metrology.refusal import fields_of
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest
from stepdiag_ros.metrology.target import TargetStanding
from stepdiag_ros.text.intake import parse_yaml
from stepdiag_ros.topics import Topic

Event = StopCommand | Arrival | Reading


class StateChange(NamedTuple):
    """A change of the run's state, without the heartbeats in between.

    Attributes:
        time: ns.
        state: STATE_* of RunState.msg.
        line_index: of the plan, from 0.
        line: in words.
        stop: from 0.
        text: why it is in this state, in plain words.
        target: how far the run is from its target; None if it has none.
    """

    time: int
    state: int
    line_index: int
    line: str
    stop: int
    text: str
    target: TargetStanding | None = None


class Diagnostic(NamedTuple):
    """A change in what a part of the system says of itself: time (ns), level (0 good), who."""

    time: int
    level: int
    name: str
    message: str


@dataclass(frozen=True)
class RecordedRun:
    """What a bag says about one run. Readings are many, so they are read when asked for.

    Attributes:
        bag: open as long as the run is in use, so that what is read later is of the same recording.
        found: what in the bag belongs to the run.
        all_readings: of the run.
        namespace: that the run's topics were in.
        run_id: identity of the run.
        software_version: of stepdiag_ros that made the run.
        schema_version: of its messages.
        start_time: ns.
        plan_text: YAML of the test plan.
        machine_text: YAML of the machine.
        cell_text: YAML of the simulated cell; empty on a real machine.
        until: uncertainty that the run was to reach, as in RunDescription; empty: none.
        told_by_source: facts in words from the file that the bag was imported from, name → text;
            empty of a run that was recorded.
        plan: the test plan; its feed is NaN where it is not known (imported tables).
        first_command: number of the first command to the machine that is in the bag, from
            1; 0 without a command.
        commands: that end at a stop.
        arrivals: in position.
        stops: settled or rejected, as recorded.
        blocks: as recorded.
        lines: as recorded, every attempt.
        results: of all solvers, as recorded.
        tests: of positioning, by ISO 230-2 and ISO 230-6, as recorded.
        diagnoses: of the lines as they came, as recorded; the last is that of the whole run, if its
            ``run_over`` says so.
        states: changes of the run's state.
        diagnostics: changes of what the parts say of themselves.
        flaws: what is wrong with the recording: missing, doubled, out of order.
    """

    bag: Bag
    found: FoundRun
    all_readings: RunReadings
    namespace: str
    run_id: str
    software_version: str
    schema_version: int
    start_time: int
    plan_text: str
    machine_text: str
    cell_text: str
    until: str
    told_by_source: Mapping[str, str]
    plan: Plan
    first_command: int
    commands: tuple[StopCommand, ...]
    arrivals: tuple[Arrival, ...]
    stops: tuple[SettledStop, ...]
    blocks: tuple[BlockDisplacement, ...]
    lines: tuple[MeasuredLine, ...]
    results: tuple[VolumetricErrors, ...]
    tests: tuple[PositioningTest, ...]
    diagnoses: tuple[DiagnosisSummary, ...]
    states: tuple[StateChange, ...]
    diagnostics: tuple[Diagnostic, ...]
    flaws: tuple[Flaw, ...]

    @property
    def path(self) -> Path:
        """Return the path of the bag."""
        return self.bag.path

    @property
    def begun_late(self) -> bool:
        """Say whether the recording lacks the run's first commands: it began after the run did."""
        return self.first_command > 1

    @property
    def volume(self) -> Volume:
        """Return the measured box."""
        return self.plan.volume

    @cached_property
    def machine(self) -> Mapping[str, Any]:
        """Return the machine's YAML, parsed; of an imported table only its case file."""
        parsed = parse_yaml(self.machine_text, f"{self.path}: machine") if self.machine_text else {}
        return parsed if isinstance(parsed, Mapping) else {}

    @property
    def simulated_cell(self) -> str:
        """Return the name of the simulated cell; empty on a real machine."""
        if not self.cell_text:
            return self.told_by_source.get(SIMULATED_CELL, "")
        parsed = parse_yaml(self.cell_text, f"{self.path}: cell")
        return str(parsed.get("name", UNKNOWN)) if isinstance(parsed, Mapping) else UNKNOWN

    @property
    def chain(self) -> str:
        """Return the order of the axes from workpiece to tool, such as YXZ; empty if not known."""
        return chain_from_text(self.machine_text, f"{self.path}: machine")

    @property
    def measurement(self) -> Measurement:
        """Return the recorded lines, each with its last attempt, over the measured box."""
        plausible = plausible_from_text(self.machine_text, f"{self.path}: machine")
        return Measurement(self.volume, latest_attempts(self.lines), self.chain, plausible)

    def events(self) -> Iterator[Event]:
        """Go through commands, arrivals and readings in the order in which they were recorded."""
        convert: dict[str, Callable[[Any], Event | None]] = {
            topics.absolute(topics.READING, self.namespace): conversion.to_reading,
            topics.absolute(topics.MACHINE_COMMAND, self.namespace): self._own_command,
            topics.absolute(topics.COMMAND_STATUS, self.namespace): self._own_arrival,
        }
        for record, message in messages_of(self.bag, self.found, convert.keys()):
            event = self.bag.converted(record, convert[record.topic], message)
            if event is not None:
                yield event

    def readings(self) -> Iterator[Reading]:
        """Go through the readings in the order in which they were recorded."""
        return chain.from_iterable(self.reading_batches())

    def reading_batches(self) -> Iterator[ReadingBatch]:
        """Go through the readings in the order in which they were recorded, many at a time."""
        return self.all_readings.batches()

    def positions(self) -> Iterator[tuple[int, tuple[float, float, float]]]:
        """Go through time (ns) and position (m) of the axes, in the order of recording."""
        if not self.plan.on_the_fly:
            return
        joints = topics.absolute(topics.JOINT_STATES, self.namespace)
        for _, message in messages_of(self.bag, self.found, (joints,)):
            position = conversion.axis_positions(message)
            if position is not None:
                yield to_nanoseconds(message.header.stamp), position

    def weather(self) -> list[SensorValue]:
        """Return the values of the weather sensors, in order of time."""
        told = {
            topics.absolute(topic, self.namespace): (name, field)
            for name, (topic, field) in topics.WEATHER.items()
        }
        values = []
        for record, message in messages_of(self.bag, self.found, told.keys()):
            name, field = told[record.topic]
            time = to_nanoseconds(message.header.stamp)
            values.append(SensorValue(time, name, float(getattr(message, field))))
        return sorted(values, key=lambda value: value.time)

    def _own_command(self, message: Any) -> StopCommand | None:
        return conversion.to_stop_command(message) if message.run_id == self.run_id else None

    def _own_arrival(self, message: Any) -> Arrival | None:
        return conversion.to_arrival(message) if message.run_id == self.run_id else None


def load_run(path: str | Path, run_id: str | None = None) -> RecordedRun:
    """Read a bag's run.

    Args:
        path: the bag.
        run_id: which run, where a bag holds more than one.

    Raises:
        BagError: the bag is cut off or damaged, or holds no run, several, or one that cannot be
            read, for example of a newer schema version.
    """
    bag = open_bag(path)
    try:
        return _run_of(bag, choose_run(bag, run_id))
    except BaseException:
        bag.close()
        raise


def _run_of(bag: Bag, found: FoundRun) -> RecordedRun:
    description = found.description
    check_version(bag.path, description.schema_version, description.software_version)
    try:
        plan = plan_from_text(description.plan, f"{bag.path}: plan")
    except ValueError as error:
        raise BagError(str(error), **fields_of(error)) from None
    readings = RunReadings(bag, found)
    return RecordedRun(
        bag=bag,
        found=found,
        all_readings=readings,
        namespace=found.namespace,
        run_id=description.run_id,
        software_version=description.software_version,
        schema_version=int(description.schema_version),
        start_time=to_nanoseconds(description.header.stamp),
        plan_text=description.plan,
        machine_text=description.machine,
        cell_text=description.simulated_cell,
        until=str(getattr(description, "until", "")),
        told_by_source=_told_by_source(bag),
        plan=plan,
        **_parts(bag, found, plan, readings),
    )


def _told_by_source(bag: Bag) -> Mapping[str, str]:
    try:
        return bag.header.told_by_source()
    except BagError:  # a bag of another recorder
        return {}


def check_version(path: Path, version: int, software_version: str) -> None:
    """Refuse a bag whose messages may mean something else than this program takes them for.

    Args:
        path: of the bag, for the text of an error.
        version: schema version of the run.
        software_version: of stepdiag_ros that made it.

    Raises:
        BagError: the version is newer than this program, or the version is missing.
    """
    newest = own_types().constant(topics.RUN_DESCRIPTION.type_name, "SCHEMA_VERSION")
    if version > newest:
        raise BagError(
            f"{path} was made by stepdiag_ros {software_version}: its messages have schema "
            f"version {version}, but this program reads up to {newest}. Install a newer version"
        )
    if version < 1:
        raise BagError(
            f"{path}: the run has no schema version, so its numbers cannot be interpreted"
        )


def _parts(bag: Bag, run: FoundRun, plan: Plan, readings: RunReadings) -> dict[str, Any]:
    converters: dict[Topic, tuple[str, Callable[[Any], Any]]] = {
        topics.MACHINE_COMMAND: ("commands", conversion.to_stop_command),
        topics.COMMAND_STATUS: ("arrivals", conversion.to_arrival),
        topics.STOP: ("stops", conversion.to_settled_stop),
        topics.BLOCK: ("blocks", conversion.to_block),
        topics.LINE: ("lines", conversion.to_measured_line),
        topics.VOLUMETRIC_ERRORS: ("results", to_volumetric_errors),
        topics.POSITIONING_TEST: ("tests", to_positioning_test),
        topics.DIAGNOSIS: ("diagnoses", to_diagnosis),
        topics.RUN_STATE: ("states", _state_change),
    }
    by_name = {topics.absolute(topic, run.namespace): entry for topic, entry in converters.items()}
    parts: dict[str, list[Any]] = {name: [] for name, _ in converters.values()}
    diagnostics = _DiagnosticChanges()
    diagnostics_name = topics.absolute(topics.DIAGNOSTICS)
    command_ids: set[int] = set()
    for record, message in messages_of(bag, run, (*by_name, diagnostics_name)):
        if record.topic == diagnostics_name:
            diagnostics.add(message)
            continue
        name, convert = by_name[record.topic]
        if message.run_id != run.run_id:
            continue
        if name == "commands":
            command_ids.add(int(message.command_id))
        converted = bag.converted(record, convert, message)
        if converted is not None and not _only_heartbeat(parts[name], converted):
            parts[name].append(converted)
    promised = Recorded(
        namespace=run.namespace,
        command_ids=command_ids,
        arrivals=parts["arrivals"],
        stops=parts["stops"],
        blocks=parts["blocks"],
        lines=parts["lines"],
        last_state=parts["states"][-1].state if parts["states"] else None,
        readings=numbers_of_readings(readings.batches()),
    )
    return {
        **{name: tuple(found) for name, found in parts.items()},
        "diagnostics": tuple(diagnostics.changes),
        "first_command": promised.first_command,
        "flaws": _flaws(bag, promised, plan),
    }


def _flaws(bag: Bag, promised: Recorded, plan: Plan) -> tuple[Flaw, ...]:
    counted = bag.flaws()
    known = {topic for flaw in counted for topic in flaw.messages}
    stops = [len(line.stops(plan.volume)) for line in plan.lines]
    return (*counted, *promised.flaws(known, stops))


def _state_change(message: Any) -> StateChange:
    return StateChange(
        time=to_nanoseconds(message.header.stamp),
        state=int(message.state),
        line_index=int(message.line_index),
        line=str(message.line),
        stop=int(message.stop),
        text=str(message.text),
        target=target_of(message),
    )


def _only_heartbeat(before: list[Any], new: Any) -> bool:
    if not isinstance(new, StateChange) or not before:
        return False
    last: StateChange = before[-1]
    return (last.state, last.line_index, last.text) == (new.state, new.line_index, new.text)


class _DiagnosticChanges:
    """Keeps what is new in a stream of repeated diagnostics."""

    def __init__(self) -> None:
        self.changes: list[Diagnostic] = []
        self._last: dict[str, tuple[int, str]] = {}

    def add(self, message: Any) -> None:
        time = to_nanoseconds(message.header.stamp)
        for status in message.status:
            raw = status.level
            level = raw[0] if isinstance(raw, bytes) else int(raw)
            said = (level, str(status.message))
            if self._last.get(status.name) != said:
                self._last[status.name] = said
                self.changes.append(Diagnostic(time, level, str(status.name), said[1]))
