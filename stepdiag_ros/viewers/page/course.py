"""Sections about the progress of a run: where it is, the picture of the volume, the axes."""

from typing import Any, ClassVar

import numpy as np

from stepdiag_ros import topics
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.plan import Plan, Volume
from stepdiag_ros.metrology.target import TargetStanding
from stepdiag_ros.metrology.tracker.tracked_line import station_of
from stepdiag_ros.metrology.units import IN_MILLI
from stepdiag_ros.run.sequence import State
from stepdiag_ros.run.target_words import course_words
from stepdiag_ros.text.numbers import UNKNOWN, time_left
from stepdiag_ros.viewers.page.contact import QUIET_AFTER, Contact
from stepdiag_ros.viewers.page.control import LEADERS
from stepdiag_ros.viewers.page.items import AxisPlace, MachineStatus, RunBegin, RunStatus
from stepdiag_ros.viewers.page.section import PageSection, drawn, measured
from stepdiag_ros.viewers.scene.progress_markers import LineCourse, courses

STATE_WORDS = {
    State.IDLE: "nothing is measured",
    State.RUNNING: "measuring",
    State.PAUSED: "paused",
    State.WAITING_FOR_SETUP: "waits for laser and mirror to be set up",
    State.FINISHED: "finished",
    State.ABORTED: "aborted",
    State.FAULT: "stopped by a fault",
}
ENDED = (State.FINISHED, State.ABORTED)
_POINTS = 200
"""Points of a drawn line, at most; a line of more stops is drawn by its ends."""


class RunSection(PageSection):
    """Which run it is, where it is, how long it takes still, and what may be asked of it."""

    name: ClassVar[str] = "run"

    def __init__(self) -> None:
        self._contact: Contact | None = None
        super().__init__()

    def begin(self, run: RunBegin | None) -> None:
        """Take up a run."""
        self._run = run
        self._status: RunStatus | None = None

    def take(self, item: object) -> bool:
        """Take the run's own word on where it is, and whether somebody is there to start one."""
        if isinstance(item, Contact):
            before, self._contact = self._refused_start(), item
            return self._refused_start() != before
        if not isinstance(item, RunStatus):
            return False
        # Numbers that are not known are never equal, and no news all the same.
        last = self._status
        changed = last is None or repr(item._replace(time=last.time)) != repr(last)
        self._status = item
        return changed

    def document(self) -> dict[str, Any]:
        """Return it in words and counts."""
        run, status = self._run, self._status
        plan = run.plan if run else None
        document: dict[str, Any] = {
            "run_id": run.run_id if run else "",
            "plan": plan.name if plan else "",
            "simulated": bool(run and run.simulated),
            "state": status.state.name if status else None,
            "words": STATE_WORDS[status.state] if status else "no run is known yet",
            "refused_start": self._refused_start(),
        }
        if status is None:
            return document
        if plan and plan.tracker is not None and status.state is State.WAITING_FOR_SETUP:
            document["words"] = "waits for the tracker to be set up"
        under_way = status.run_id != "" and status.state not in ENDED
        block = block_count = 0
        tracked = plan is not None and plan.tracker is not None
        if plan and not tracked and status.line_index < len(plan.lines):
            line = plan.lines[status.line_index]
            block, block_count = line.block_of(status.stop), plan.volume.blocks
        total = status.stops_total
        return document | {
            "line": status.line if under_way else "",
            "line_number": status.line_index + 1,
            "line_count": status.line_count,
            "setup": status.setup,
            "block": block,
            "block_count": block_count,
            "stop": status.stop,
            "stop_count": status.stop_count,
            "stops_done": status.stops_done,
            "stops_total": total,
            "share": status.stops_done / total if total else None,
            "remaining_s": drawn(status.remaining_time) if under_way else None,
            "remaining": self._remaining(status.remaining_time) if under_way else "",
            "text": status.text,
            "target": course_words(status.standing[-1]) if status.standing else "",
            "target_share": _share_of_target(status.standing),
        }

    def _remaining(self, seconds: float) -> str:
        text = time_left(seconds)
        simulated = self._run is not None and self._run.simulated and text != UNKNOWN
        return f"{text} of machine time" if simulated else text

    def _refused_start(self) -> str:
        """Return why no run can be started; nothing if one can, or if that is not known."""
        if self._contact is None or self._contact.roles.intersection(LEADERS):
            return ""
        return "no message from a sequencer"


def _share_of_target(standing: tuple[TargetStanding, ...]) -> float | None:
    """Return how near the uncertainty is to the target: 1 where it is reached; None if unknown."""
    if not standing or not standing[-1].reached > 0.0:
        return None
    return drawn(min(1.0, standing[-1].demanded / standing[-1].reached))


class VolumeSection(PageSection):
    """The box that is measured and the lines through it, as they stand in the plan."""

    name: ClassVar[str] = "volume"

    def begin(self, run: RunBegin | None) -> None:
        """Take up the lines of a plan."""
        self._run = run

    def take(self, item: object) -> bool:
        """Nothing of it changes in a run."""
        del item
        return False

    def document(self) -> dict[str, Any]:
        """Return corners and lines, in mm of the machine's coordinates."""
        if self._run is None:
            return {"box": None, "courses": [], "stations": []}
        plan = self._run.plan
        volume = plan.volume
        corners = np.array([[volume.nodes(axis)[end] for axis in range(3)] for end in (0, -1)])
        return {
            "box": _millimetres(corners),
            "courses": [
                {
                    "name": course.name,
                    "passes": len(course.passes),
                    "path": _millimetres(_path(course, volume)),
                    "places": not course.along_a_line,
                }
                for course in courses(plan)
            ],
            "stations": _stations(plan),
        }


class ProgressSection(PageSection):
    """How far each of these lines is, and the present block."""

    name: ClassVar[str] = "progress"

    def begin(self, run: RunBegin | None) -> None:
        """Take up a plan of which nothing is measured."""
        self._plan = run.plan if run else None
        self._courses: tuple[LineCourse, ...] = courses(run.plan) if run else ()
        self._measured: dict[int, bool] = {}
        self._present: tuple[int, int] | None = None

    def take(self, item: object) -> bool:
        """Take finished lines, and where the run is."""
        if isinstance(item, MeasuredLine):
            self._measured[item.line_index] = item.complete
            return True
        if not isinstance(item, RunStatus) or self._plan is None:
            return False
        at_work = item.run_id and item.state not in ENDED
        inside = item.line_index < len(self._plan.lines)
        present = (item.line_index, item.stop) if at_work and inside else None
        changed, self._present = present != self._present, present
        return changed

    def document(self) -> dict[str, Any]:
        """Return for each line of the drawing how it stands."""
        return {
            "courses": [
                {
                    "done": sum(one in self._measured for one in course.passes),
                    "incomplete": sum(not self._measured.get(one, True) for one in course.passes),
                    "look": self._look(course),
                }
                for course in self._courses
            ],
            "block": self._block(),
        }

    def _look(self, course: LineCourse) -> str:
        known = [self._measured[one] for one in course.passes if one in self._measured]
        if self._present is not None and self._present[0] in course.passes:
            return "present"
        if not all(known):
            return "incomplete"
        return "measured" if len(known) == len(course.passes) else "left"

    def _block(self) -> list[list[float]] | None:
        """Return the move that is being made, from the stop before to the present one."""
        if self._plan is None or self._present is None:
            return None
        line_index, stop = self._present
        line = self._plan.lines[line_index]
        stops = line.stops(self._plan.volume)
        straight = line.tracked is None or line.tracked.straight
        if not straight or not 0 < stop < len(stops):
            return None
        return _millimetres(stops[stop - 1 : stop + 1])


class PositionSection(PageSection):
    """Where the tool is, and whether the machine says that it is stopped or faulty."""

    name: ClassVar[str] = "position"
    of_run = False

    def begin(self, run: RunBegin | None) -> None:
        """Start empty."""
        del run
        self._place: AxisPlace | None = None
        self._trouble = ""
        self._silence = ""

    def take(self, item: object) -> bool:
        """Take positions, the machine's state, and whether positions still come."""
        if isinstance(item, Contact):
            before, self._silence = self._silence, _silence(item)
            return self._silence != before
        if isinstance(item, AxisPlace):
            changed = self._place is None or item.position != self._place.position
            self._place = item
            return changed
        if isinstance(item, MachineStatus):
            trouble = (item.reason or "the machine is stopped") if item.troubled else ""
            changed, self._trouble = trouble != self._trouble, trouble
            return changed
        return False

    def document(self) -> dict[str, Any]:
        """Return X, Y, Z in mm, and each with its unit; not known where they come no more."""
        known = self._place if not self._silence else None
        place = known.position if known else (np.nan,) * 3
        silence = self._silence or ("no position has come yet" if known is None else "")
        return {
            "at": [drawn(value, IN_MILLI) for value in place] if known else None,
            "words": f"not known: {silence}" if silence else "",
            "texts": {
                axis: measured(float(value), "mm", 3, IN_MILLI)
                for axis, value in zip(AXES, place, strict=True)
            },
            "trouble": self._trouble,
        }


def _silence(contact: Contact) -> str:
    if contact.misses("cnc_bridge"):
        return "the bridge to the machine is silent"
    if topics.JOINT_STATES.name in contact.quiet:
        return f"no position has come for {QUIET_AFTER:g} s"
    return ""


def _path(course: LineCourse, volume: Volume) -> Vector:
    stops = course.line.stops(volume)
    return stops if len(stops) <= _POINTS or not course.along_a_line else stops[[0, -1]]


def _stations(plan: Plan) -> list[dict[str, Any]]:
    """Return name and place of each station of a tracker, mm; nothing of other plans."""
    places = {
        station_of(line.name): line.tracked.station
        for line in plan.lines
        if line.tracked is not None
    }
    return [
        {"name": name, "at": _millimetres(np.array([place]))[0]} for name, place in places.items()
    ]


def _millimetres(points: Vector) -> list[list[float]]:
    rounded: list[list[float]] = np.round(np.asarray(points) * IN_MILLI, 4).tolist()
    return rounded
