"""A run that was measured by hand: recordings, a plan, and what was found in them, as a bag.

The stops that are found (``metrology.by_hand``) are written as a run like any other: plan,
readings, commands, words on commands, stops, blocks, lines and a last state. The commands have no
feed, because nobody has given them, and no position of the machine, because it is unknown.
The plan is that of the measurement but for ``longest_wait_s``, for no machine waited.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from typing import Any

from stepdiag_ros import topics
from stepdiag_ros.bags.errors import BagError
from stepdiag_ros.bags.header import Attachment
from stepdiag_ros.bags.imports.source import PREFIX
from stepdiag_ros.bags.imports.writing import ToWrite, write_bag
from stepdiag_ros.bags.recording import Recording
from stepdiag_ros.bags.types import own_types
from stepdiag_ros.messages import conversion
from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.metrology.assembly import Event, assemble
from stepdiag_ros.metrology.by_hand import (
    Found,
    Numbering,
    as_commanded,
    find_stops,
    objection_to,
    plan_by_hand,
    silences,
)
from stepdiag_ros.metrology.hand_lines import LineFound
from stepdiag_ros.metrology.measurement import (
    Arrival,
    BlockDisplacement,
    MeasuredLine,
    SettledStop,
    StopCommand,
)
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.topics import Topic

_STATE_FINISHED = 4


@dataclass(frozen=True)
class HandRun:
    """A run that was measured by hand.

    Attributes:
        plan: as it was measured, with the stops settling or not as the machine left them.
        plan_text: YAML of it.
        machine_text: YAML of the machine; empty if nothing is known.
        recordings: that it was found in, one after another in time.
        found: in each of them.
        commands: that the machine has followed, as far as it was seen.
        arrivals: at the stops.
        events: what was assembled.
    """

    plan: Plan
    plan_text: str
    machine_text: str
    recordings: tuple[Recording, ...]
    found: tuple[Found, ...]
    commands: tuple[StopCommand, ...]
    arrivals: tuple[Arrival, ...]
    events: tuple[Event, ...]

    @property
    def looked_for(self) -> tuple[LineFound, ...]:
        """Return what was found of each line, in the order in which they were looked for."""
        return tuple(line for found in self.found for line in found.lines)

    @property
    def lines(self) -> tuple[MeasuredLine, ...]:
        """Return the lines that were measured."""
        return tuple(event for event in self.events if isinstance(event, MeasuredLine))

    @property
    def words(self) -> tuple[str, ...]:
        """Return what there is to say, sentence by sentence: refusals, remarks, rejected stops."""
        said = []
        for recording, found in zip(self.recordings, self.found, strict=True):
            for line in found.lines:
                name = self.plan.lines[line.line_index]
                if line.refusal:
                    said.append(f"{name}: no result: {line.refusal}")
                said += [f"{name}: {remark}" for remark in line.remarks]
            if found.hint:
                said.append(f"{recording.path.name}: {found.hint}")
            said += [f"{recording.path.name}: {one}" for one in silences(recording.readings)]
        for event in self.events:
            if isinstance(event, SettledStop) and not event.settled:
                said.append(f"{event.line}, stop {event.command.stop}: rejected: {event.reason}")
        return tuple(said)

    @property
    def text(self) -> str:
        """Return how the run went, for its last state."""
        done = f"measured by hand: {len(self.lines)} of {len(self.looked_for)} lines"
        return "; ".join((done, *self.words))


def measure_by_hand(
    plan: Plan,
    plan_text: str,
    machine_text: str,
    recordings: Sequence[Recording],
    lines: Sequence[Sequence[int]],
) -> HandRun:
    """Find the stops of a plan in recordings and assemble what they give.

    Args:
        plan: of the measurement.
        plan_text: YAML of it; used for its lines and times, ``longest_wait_s`` is replaced.
        machine_text: YAML of the machine; empty to take what the recordings state.
        recordings: in order of measurement, one after another in time.
        lines: for each recording the lines of the plan that it is to hold.

    Raises:
        ValueError: a recording cannot be evaluated with this plan at all; one sentence.
    """
    hand = plan_by_hand(plan)
    numbering = Numbering()
    founds, commands, arrivals = [], [], []
    for number, (recording, own) in enumerate(zip(recordings, lines, strict=True)):
        objection = objection_to(plan, recording.readings)
        if objection:
            raise BagError(f"{recording.path}: {objection}")
        found = find_stops(plan, own, recording.readings)
        given, reached = as_commanded(hand, found, number, numbering)
        founds.append(found)
        commands += given
        arrivals += reached
    readings = (reading for recording in recordings for reading in recording.readings)
    start = recordings[0].readings[0].time
    told = next((one.machine_text for one in recordings if one.machine_text), "")
    return HandRun(
        plan=hand,
        plan_text=plan_text,
        machine_text=machine_text or told,
        recordings=tuple(recordings),
        found=tuple(founds),
        commands=tuple(commands),
        arrivals=tuple(arrivals),
        events=tuple(assemble(hand, start, commands, arrivals, readings)),
    )


def lines_of_recordings(plan: Plan, count: int) -> list[list[int]]:
    """Return which lines of a plan are in which of some recordings, where nobody has said it.

    One recording holds all of them; as many as there are setups, or lines, one of these each.

    Raises:
        ValueError: the number of recordings does not determine it.
    """
    every = list(range(len(plan.lines)))
    if count == 1:
        return [every]
    setups: list[list[int]] = []
    for index in every:
        if index and plan.setup_of(plan.lines[index]) == plan.setup_of(plan.lines[index - 1]):
            setups[-1].append(index)
        else:
            setups.append([index])
    if count == len(setups):
        return setups
    if count == len(every):
        return [[index] for index in every]
    raise ValueError(
        f"{count} recordings for a plan of {len(setups)} setups and {len(every)} lines: say for "
        "each of them which lines it holds, by one --lines FIRST-LAST each"
    )


def write_hand_run(target: Path, run: HandRun) -> str:
    """Make the bag of a run that was measured by hand; it appears when it is whole.

    Returns:
        identity of the run, the same for the same recordings and plan.

    Raises:
        BagError: the target exists, its folder does not, or it cannot be written.
    """
    content = hashlib.sha256(run.plan_text.encode())
    sources: dict[str, Attachment] = {}
    facts: dict[str, str] = {}
    for number, recording in enumerate(run.recordings, start=1):
        for attachment in recording.sources:
            content.update(attachment.data)
            name = attachment.name
            if name in sources and sources[name].data != attachment.data:
                name = f"{PREFIX}{number}/{name.removeprefix(PREFIX)}"
            sources[name] = replace(attachment, name=name)
        content.update(repr(recording.readings[:: max(1, len(recording.readings) // 999)]).encode())
        said = {f"recording {number}: {name}": text for name, text in recording.facts.items()}
        facts |= {f"recording {number}": recording.path.name, **said}
    run_id = f"by-hand-{run.recordings[0].path.stem}-{content.hexdigest()[:12]}"
    write_bag(
        target,
        ToWrite(
            run_id=run_id,
            plan_name=f"measured by hand: {run.recordings[0].path.name}",
            middleware="none: measured by hand",
            plan=run.plan_text,
            machine=run.machine_text,
            facts={"measured": run.text, **facts},
            attachments=tuple(sources.values()),
            readings=tuple(one for recording in run.recordings for one in recording.readings),
            start_time=run.recordings[0].readings[0].time,
            further=tuple(_messages(run, run_id)),
        ),
    )
    return run_id


def _messages(run: HandRun, run_id: str) -> list[tuple[int, Topic, Any]]:
    """Return what else is in the bag: time (ns), topic and message, in order of time."""
    new = own_types().new
    told: list[tuple[int, Topic, Any]] = []
    for command, arrival in zip(run.commands, run.arrivals, strict=True):
        message = conversion.from_stop_command(command, run_id, command.time, nan, new=new)
        told.append((command.time, topics.MACHINE_COMMAND, message))
        word = conversion.from_command_status(
            command.command_id,
            run_id,
            arrival.time,
            conversion.STATUS_IN_POSITION,
            command.target,
            arrival.position,
            new=new,
        )
        told.append((max(arrival.time, command.time), topics.COMMAND_STATUS, word))
    last = run.recordings[0].readings[0].time
    for event in run.events:
        if isinstance(event, SettledStop):
            last = event.window_end
            stop = conversion.from_settled_stop(event, run_id, new)
            told.append((last, topics.STOP, stop))
        elif isinstance(event, BlockDisplacement):
            told.append((last, topics.BLOCK, conversion.from_block(event, run_id, new)))
        else:
            told.append((last, topics.LINE, conversion.from_measured_line(event, run_id, new)))
    state = new(topics.RUN_STATE.type_name)
    end = run.recordings[-1].readings[-1].time
    set_header(state, end)
    state.run_id, state.state, state.text = run_id, _STATE_FINISHED, run.text
    told.append((end, topics.RUN_STATE, state))
    return sorted(told, key=lambda one: one[0])
