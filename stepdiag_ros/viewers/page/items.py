"""Parts of the live page: each topic that it subscribes to, and what a message becomes.

Live nodes and bags go through the same table, so that a replay shows what a viewer has seen.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

from stepdiag_ros import topics
from stepdiag_ros.configuration import chain_from_text, plan_from_text
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.diagnosis import to_diagnosis
from stepdiag_ros.messages.fields import Carried, Field, Header, to_nanoseconds
from stepdiag_ros.messages.target import TARGET
from stepdiag_ros.messages.volumetric import to_volumetric_errors
from stepdiag_ros.metrology.air.recompensation import SensorValue
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.target import TargetStanding
from stepdiag_ros.run.sequence import State
from stepdiag_ros.run.supervision import GETTING_READY
from stepdiag_ros.topics import Topic


@dataclass(frozen=True)
class RunBegin:
    """A run, before anything of it is measured.

    Attributes:
        run_id: its identity.
        time: of its start, ns.
        plan: that is measured.
        chain: order of the machine's axes from workpiece to tool; empty if not known.
        simulated: the machine is a simulated one.
    """

    run_id: str
    time: int
    plan: Plan
    chain: str
    simulated: bool


class RunStatus(NamedTuple):
    """Where a run is; fields as in RunState.msg, time in ns, NaN for a time left not known.

    ``standing`` is empty or has one entry.
    """

    time: int
    run_id: str
    state: State
    line_index: int
    line_count: int
    line: str
    setup: str
    stop: int
    stop_count: int
    stops_done: int
    stops_total: int
    remaining_time: float
    text: str
    standing: tuple[TargetStanding, ...] = ()


_RUN_STATUS = Carried(RunStatus, time=Header(), state=Field("state", State), standing=TARGET)


class MachineStatus(NamedTuple):
    """What the bridge says of the machine.

    Attributes:
        time: ns.
        troubled: it is stopped or faulty.
        reason: why.
        faulty: it is not merely stopped.
    """

    time: int
    troubled: bool
    reason: str
    faulty: bool = False


class AxisPlace(NamedTuple):
    """Where the axes are, m, at a time (ns)."""

    time: int
    position: tuple[float, float, float]


class Said(NamedTuple):
    """What a part of a node says of itself on /diagnostics.

    Attributes:
        name: ``node: task``.
        level: of diagnostic_msgs/DiagnosticStatus.
        message: in words.
        starting: it has not begun yet, and says that it is about to.
    """

    name: str
    level: int
    message: str
    starting: bool = False


@dataclass(frozen=True)
class HeardTopic:
    """A topic that the page subscribes to.

    Attributes:
        topic: which.
        convert: a message to what the page folds in; several, or none where it contains nothing.
        newest: the newest message is enough; those in between need not be looked at.
    """

    topic: Topic
    convert: Callable[[Any], Iterable[Any]]
    newest: bool = False


def to_run_begin(message: Any) -> RunBegin:
    """Convert a ``RunDescription``.

    Raises:
        ValueError: its plan or its machine cannot be read.
    """
    return RunBegin(
        run_id=str(message.run_id),
        time=to_nanoseconds(message.header.stamp),
        plan=plan_from_text(message.plan, "plan of the run"),
        chain=chain_from_text(message.machine, "machine of the run"),
        simulated=bool(message.simulated_cell),
    )


def to_run_status(message: Any) -> RunStatus:
    """Convert a ``RunState``."""
    made: RunStatus = _RUN_STATUS.read(message)
    return made


def _machine(message: Any) -> Iterable[MachineStatus]:
    yield MachineStatus(
        to_nanoseconds(message.header.stamp),
        int(message.state) in (message.STATE_STOPPED, message.STATE_FAULT),
        str(message.reason),
        int(message.state) == message.STATE_FAULT,
    )


def _place(message: Any) -> Iterable[AxisPlace]:
    position = conversion.axis_positions(message)
    if position is not None and all(math.isfinite(value) for value in position):
        yield AxisPlace(to_nanoseconds(message.header.stamp), position)


def _said(message: Any) -> Iterable[Said]:
    for status in message.status:
        raw = status.level
        level = raw[0] if isinstance(raw, bytes) else int(raw)
        starting = any(entry.key == GETTING_READY for entry in status.values)
        yield Said(str(status.name), level, str(status.message), starting)


def _sensor(name: str, field: str) -> Callable[[Any], Iterable[SensorValue]]:
    def convert(message: Any) -> Iterable[SensorValue]:
        time = to_nanoseconds(message.header.stamp)
        yield SensorValue(time, name, float(getattr(message, field)))

    return convert


class WorstError(NamedTuple):
    """The largest error by the solver, which has the covariance that no message holds.

    Attributes:
        value: length of the longest error vector in the measured box, m; NaN if not known.
        expanded_uncertainty: of it (95 %), m.
        place: X Y Z where it is, m.
    """

    value: float
    expanded_uncertainty: float
    place: tuple[float, ...]


def _worst(message: Any) -> WorstError:
    place = tuple(float(one) for one in message.worst_place)
    return WorstError(float(message.worst_error), float(message.expanded_uncertainty), place)


def _one(convert: Callable[[Any], Any]) -> Callable[[Any], Iterable[Any]]:
    return lambda message: (convert(message),)


SOURCES: tuple[HeardTopic, ...] = (
    HeardTopic(topics.RUN_DESCRIPTION, _one(to_run_begin)),
    HeardTopic(topics.RUN_STATE, _one(to_run_status)),
    HeardTopic(topics.MACHINE_STATE, _machine),
    HeardTopic(topics.JOINT_STATES, _place, newest=True),
    HeardTopic(topics.READING, _one(conversion.to_reading), newest=True),
    HeardTopic(topics.STOP, _one(conversion.to_settled_stop)),
    HeardTopic(topics.BLOCK, _one(conversion.to_block)),
    HeardTopic(topics.LINE, _one(conversion.to_measured_line)),
    HeardTopic(topics.VOLUMETRIC_ERRORS, _one(to_volumetric_errors)),
    HeardTopic(topics.RUN_VERDICT, _one(_worst)),
    HeardTopic(topics.DIAGNOSIS, _one(to_diagnosis)),
    HeardTopic(topics.DIAGNOSTICS, _said),
    *(
        HeardTopic(topic, _sensor(name, field), newest=True)
        for name, (topic, field) in topics.WEATHER.items()
    ),
)
"""Every topic that the page subscribes to."""
