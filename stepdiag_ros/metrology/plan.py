"""The test plan: which lines are measured, in which order, with which stops."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import nan
from typing import Any

import numpy as np

from stepdiag_ros.metrology.beam import BeamPath, FixedBeam, TrackingBeam
from stepdiag_ros.metrology.checking import Section, no_more_than
from stepdiag_ros.metrology.geometry import (
    AXES,
    BODY_DIAGONALS,
    FACE_DIAGONALS,
    LINEAR_LINES,
    STEP_ORDERS,
    Vector,
    beam_direction,
    line_signs,
    move_orders,
)
from stepdiag_ros.metrology.refusal import Findings, Refusal
from stepdiag_ros.metrology.tracker.box import Box
from stepdiag_ros.metrology.tracker.instrument import Tracker
from stepdiag_ros.metrology.tracker.route import TrackerRoute
from stepdiag_ros.metrology.tracker.tracked_line import (
    TRACKER,
    TrackedLine,
    check_lines,
    is_tracked,
    lines_of_group,
    station_of,
)

LINEAR = "linear"
STEP_DIAGONAL = "step_diagonal"
DIAGONAL = "diagonal"
"""A body or face diagonal along which all its axes move at once, as ISO 230-6 tests it."""
LINE_NAMES = {
    LINEAR: LINEAR_LINES,
    STEP_DIAGONAL: (*BODY_DIAGONALS, *FACE_DIAGONALS),
    DIAGONAL: (*BODY_DIAGONALS, *FACE_DIAGONALS),
}
"""Kind of a line that a standing beam measures → the names that it may have.

A line of kind ``tracker`` has the name of its station before its own; see ``tracked_line``."""
BOX_KEYS = ("origin_m", "step_m", "blocks")
"""Of a plan file: the measured box."""
COURSE_KEYS = (
    "name",
    "repeats",
    "directions",
    "feed_m_per_s",
    "pause_for_setup",
    "one_alignment_per_diagonal",
    "overrun_m",
    "measurement",
    "sampling",
    "lines",
)
"""Of a plan file without a tracker: everything else, in the order in which it is written."""
MOST_STOPS = 20_000
"""Of a plan, all passes together; at 2 s each they take eleven hours."""
STOPS = "stops"
ON_THE_FLY = "on_the_fly"
FEWEST_MOVES = 3
"""Of a line that is measured on the fly; with fewer, its delay is not known."""
HOLD = "hold"
LEAVE = "leave"
FORWARD = "forward"
BACKWARD = "backward"
LARGEST_OVERRUN = 1.0
"""m, by which a pass may begin beyond its first stop."""


@dataclass(frozen=True)
class Volume:
    """The measured box and its grid: nodes 0..blocks of every axis.

    Attributes:
        origin: machine coordinates of the box's first corner, m.
        step: size of one block along X, Y, Z, m, each > 0.
        blocks: number of blocks N; every axis has N + 1 nodes.
    """

    origin: tuple[float, float, float]
    step: tuple[float, float, float]
    blocks: int

    def nodes(self, axis: int) -> Vector:
        """Return the machine coordinates of an axis's nodes in m, shape (blocks + 1,)."""
        return self.origin[axis] + self.step[axis] * np.arange(self.blocks + 1, dtype=np.float64)

    @property
    def all_nodes(self) -> tuple[Vector, Vector, Vector]:
        """Return the nodes of X, Y and Z; see ``nodes``."""
        return self.nodes(0), self.nodes(1), self.nodes(2)


@dataclass(frozen=True)
class Line:
    """One pass along one line.

    Attributes:
        kind: ``linear``, ``step_diagonal`` or ``diagonal``, the keys of ``LINE_NAMES``, or
            ``tracker``.
        name: x, y, z, a body diagonal, or a face diagonal; of a tracker's line that of the station
            and its own, such as ``1:xyz``.
        order: order of a block's moves along the forward direction, three letters on a body
            diagonal, two on a face; empty for lines along which all their axes move at once.
        repeat: from 0.
        direction: ``forward`` or ``backward``; backward runs the forward stops the other way round.
        offset: shift from the box's first corner of a linear line, or of a face diagonal along the
            axis that stands, m.
        mirror_offset: where the mirror is mounted, from its usual place on the tool, m; the beam is
            aligned to meet it there. A machine that turns reads otherwise with it, by an arm that
            is known.
        run: number of the run, from 1, where several are looked at together
            (``discrepancy.joint``); a plan knows of one.
        tracked: places of a tracker's line; None of other lines, and of a line whose plan is not
            at hand. It is not part of the line's identity.
    """

    kind: str
    name: str
    order: str
    repeat: int
    direction: str
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    run: int = 1
    mirror_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tracked: TrackedLine | None = field(default=None, compare=False)

    @property
    def setup(self) -> str:
        """Return the identity of the alignment and zero that the line shares with others."""
        return self._words + _at(self.offset) + self.mount

    @property
    def sense(self) -> float:
        """Return 1 of a forward pass and -1 of a backward one."""
        return 1.0 if self.direction == FORWARD else -1.0

    @property
    def mount(self) -> str:
        """Return where the mirror is mounted, as part of a setup's identity; usually nothing."""
        return f" mirror{_at(self.mirror_offset)}" if any(self.mirror_offset) else ""

    def __str__(self) -> str:
        """Say which pass this is, such as ``z@0,0.3,0 forward, repeat 1``."""
        words = of_run(self.name, self.run) if self.kind == TRACKER else self.setup
        return f"{words} {self.direction}, repeat {self.repeat}"

    @property
    def _words(self) -> str:
        if self.kind == TRACKER:
            return of_run(f"station {station_of(self.name)}", self.run)
        # A body diagonal may be measured in one plan by steps and at once: two alignments.
        words = f"{self.name} {DIAGONAL if self.kind == DIAGONAL else self.order}".strip()
        return of_run(words, self.run)

    def stops(self, volume: Volume) -> Vector:
        """Return the commanded positions of the stops in order, m, shape (stops, 3).

        A stop ends each single-axis move of a step diagonal; on other lines the stops are the nodes
        that all axes of the line reach together, the targets of ISO 230-2 and ISO 230-6.
        """
        if self.tracked is not None:
            return self.tracked.stops(self.direction == FORWARD)
        signs = line_signs(self.name)
        if self.order:
            block = np.zeros((len(self.order), 3), dtype=np.int64)
            for row, axis in enumerate(self.order):
                block[row, AXES.index(axis)] = signs[AXES.index(axis)]
        else:
            block = signs[np.newaxis]
        first = np.where(signs < 0, volume.blocks, 0)[np.newaxis]
        # Counted in nodes, so that a place is the same number on every line that comes by.
        node = np.cumsum(np.vstack((first, *[block] * volume.blocks)), axis=0)
        positions: Vector = (
            np.asarray(volume.origin) + node * np.asarray(volume.step) + np.asarray(self.offset)
        )
        return positions if self.direction == FORWARD else positions[::-1].copy()

    def beam(self, volume: Volume) -> BeamPath:
        """Return the nominal beam of the line over the measured box."""
        if self.tracked is not None:
            return TrackingBeam(np.array(self.tracked.station))
        return FixedBeam(beam_direction(self.name, np.asarray(volume.step)))

    @property
    def moves_at_once(self) -> bool:
        """Say whether all axes of the line move together from stop to stop."""
        return self.kind == DIAGONAL or (self.tracked is not None and self.tracked.straight)

    def block_of(self, stop: int) -> int:
        """Return the block, from 1 in the direction of the pass, in which a stop lies.

        The stop that ends a block belongs to it; the first of the line belongs to none: 0.
        """
        return -(-stop // max(len(self.order), 1))


def axes_at_hand(lines: Iterable[Line]) -> str:
    """Return the axes that further lines may move: all of them, or the two of a machine with two.

    That is taken for one if it was measured by step diagonals of one face, and no line moves its
    third axis.
    """
    listed = tuple(lines)
    moving = np.any([line_signs(line.name) != 0 for line in listed], axis=0)
    stepped = any(line.kind == STEP_DIAGONAL for line in listed)
    if not stepped or np.count_nonzero(moving) != 2:
        return "".join(AXES)
    return "".join(axis for axis, moves in zip(AXES, moving, strict=True) if moves)


def _at(place: tuple[float, float, float]) -> str:
    return "@" + ",".join(f"{value:g}" for value in place) if any(place) else ""


def of_run(words: str, run: int) -> str:
    """Say of which run something is, for example ``run 2: ppp XYZ``; of the first, nothing."""
    return words if run == 1 else f"run {run}: {words}"


def alignment_of(line: Line, one_alignment_per_diagonal: bool) -> str:
    """Return the identity of the alignment and zero that a line is measured with; see ``Plan``."""
    if one_alignment_per_diagonal and line.kind == STEP_DIAGONAL:
        return line.name + line.mount
    return line.setup


def kind_of(name: str, order: str) -> str:
    """Return the kind of the line that has a name and an order of moves."""
    if order:
        return STEP_DIAGONAL
    if is_tracked(name):
        return TRACKER
    return LINEAR if name in LINEAR_LINES else DIAGONAL


def moved_axes(before: Vector, after: Vector) -> str:
    """Return the axes that move between two positions (X, XY, XYZ …); empty if none does."""
    moved = np.asarray(after) != np.asarray(before)
    return "".join(axis for axis, moves in zip(AXES, moved, strict=True) if moves)


@dataclass(frozen=True)
class Sampling:
    """When a stop counts as settled, and how its readings are taken.

    Attributes:
        dwell: shortest stay at a stop after in position, s.
        settle: wait after in position before readings are looked at, s.
        window: length of the window of readings that is averaged, s.
        longest_wait: after in position without a settled window the stop is rejected, s.
        standard_deviation_limit: of the readings in a window, m.
        drift_limit: change over the window by its fitted slope, m.
        stop_attempts: how often a stop that does not settle, though the zero is kept, is measured
            before its line is started again.
        line_attempts: how often a line with a rejected stop is measured before ``after_attempts``.
        after_attempts: ``hold``: the run stops until an operator has seen to it; ``leave``: the
            line is left incomplete.
    """

    dwell: float = 0.5
    settle: float = 0.1
    window: float = 0.3
    longest_wait: float = 3.0
    standard_deviation_limit: float = 1e-6
    drift_limit: float = 0.5e-6
    stop_attempts: int = 2
    line_attempts: int = 2
    after_attempts: str = HOLD


@dataclass(frozen=True)
class Plan:
    """A whole test.

    Attributes:
        name: in words.
        volume: the measured box.
        lines: passes in the order in which they are measured.
        feed: of the moves, m/s; NaN where only the result of a measurement is at hand.
        sampling: how stops are read.
        pause_for_setup: wait for the operator before each new setup (laser and mirror to be
            aligned).
        one_alignment_per_diagonal: all move orders of a step diagonal are measured in one setup,
            as Ibaraki & Hata 2010, section 4.2, do; else each order is aligned again.
        overrun: how far the machine goes beyond the first stop of a pass before it comes back to
            it, m, so that every stop of the pass is approached in its direction, as the
            bidirectional tests of ISO 230-2 and ISO 230-6 need it. Step diagonals have none: each
            of their moves ends at a stop; a tracker's lines have their own.
        measurement: ``stops``: the machine stays at every stop until it is measured;
            ``on_the_fly``: only at the first and the last of a line, and every move between them is
            measured while it is made (``metrology.on_the_fly``).
        tracker: the instrument of a plan whose lines are all of kind ``tracker``; else None.
    """

    name: str
    volume: Volume
    lines: tuple[Line, ...]
    feed: float
    sampling: Sampling = field(default_factory=Sampling)
    pause_for_setup: bool = True
    one_alignment_per_diagonal: bool = False
    overrun: float = 0.0
    tracker: Tracker | None = None
    measurement: str = STOPS

    @property
    def on_the_fly(self) -> bool:
        """Say whether lines are measured while the axes move."""
        return self.measurement == ON_THE_FLY

    def setup_of(self, line: Line) -> str:
        """Return the identity of the alignment and zero that a line is measured with."""
        return alignment_of(line, self.one_alignment_per_diagonal)

    def overrun_of(self, line: Line) -> float:
        """Return how far beyond its first stop a pass is begun, m; step diagonals never are."""
        if line.tracked is not None:
            return line.tracked.overrun
        return 0.0 if line.kind == STEP_DIAGONAL else self.overrun

    def run_up(self, line: Line) -> Vector | None:
        """Return the place beyond a pass's first stop, m, shape (3,); None if it begins at that.

        Source of the practice: Renishaw, laser diagonal
        testing, "backlash is eliminated by moving in the same direction before each reading".
        """
        overrun = self.overrun_of(line)
        if overrun == 0.0:
            return None
        if line.tracked is not None:
            return line.tracked.run_up(line.direction == FORWARD)
        along = line.sense * beam_direction(line.name, np.asarray(self.volume.step))
        place: Vector = line.stops(self.volume)[0] - overrun * along
        return place

    def way_back(self, line_index: int) -> Vector:
        """Return the places by which the machine comes to a line's first stop, m, shape (n, 3).

        After a line of the same alignment these are its stops the other way round, so that the
        mirror stays in the beam: otherwise the count of fringes, and with it the zero, is lost.
        There are none after another alignment, or where the line before (``line_index`` less one)
        ends at this line's first stop.
        """
        none = np.empty((0, 3))
        if line_index == 0:
            return none
        before, line = self.lines[line_index - 1], self.lines[line_index]
        if self.setup_of(before) != self.setup_of(line):
            return none
        if line.tracked is not None:
            return self.way_to(line, 0, before.stops(self.volume)[-1])
        passed = before.stops(self.volume)[::-1]
        at_first_stop = np.all(passed == line.stops(self.volume)[0], axis=1)
        if at_first_stop[0] or not np.any(at_first_stop):
            return none
        way: Vector = passed[1 : int(np.argmax(at_first_stop)) + 1]
        return way

    @property
    def corners(self) -> Vector:
        """The lowest and the highest corner of the measured box, m, shape (2, 3)."""
        low = np.array(self.volume.origin)
        return np.stack((low, low + self.volume.blocks * np.array(self.volume.step)))

    def way_to(self, line: Line, stop: int, position: Vector) -> Vector:
        """Return the places by which the machine comes to a stop of a tracker's line, m, (n, 3).

        Stops along a straight line are reached from the stop before; for all others see
        ``TrackerRoute.reach``. The stop itself is not among them.

        Raises:
            ValueError: the tracker sees the start and the stop, and there is no way between them.
        """
        assert line.tracked is not None and self.tracker is not None
        if line.tracked.straight and stop > 0:
            return np.empty((0, 3))
        stops = line.stops(self.volume)
        beyond = self.run_up(line) if stop == 0 else None
        end = stops[stop] if beyond is None else beyond
        route = TrackerRoute(Box(*self.corners), np.array(line.tracked.station), self.tracker)
        places = route.reach(np.asarray(position, dtype=np.float64), end)
        return places[:-1] if len(places) and np.all(places[-1] == stops[stop]) else places

    @property
    def stop_count(self) -> int:
        """Return the number of stops of all lines."""
        return sum(len(line.stops(self.volume)) for line in self.lines)

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], source: str) -> "Plan":
        """Make a plan from the parsed YAML of a plan file (layout in ``config/plans``).

        Raises:
            ValueError: names the source, the key, what is wrong and what is expected.
        """
        plan, findings = Section(mapping, source), Findings()
        of = findings.of
        volume = of(lambda: _volume(plan), Volume((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 1))
        repeats = of(lambda: plan.integer("repeats", low=1, high=1000, default=1), 1)
        forward: tuple[str, ...] = (FORWARD,)
        directions = of(
            lambda: plan.names("directions", (FORWARD, BACKWARD), default=forward), forward
        )
        lines = of(lambda: _lines(plan, volume, repeats, directions), None)
        told = plan.given(["tracker"]).get("tracker")
        if lines is not None:
            passes = [(line, line.name, line.tracked) for line in lines]
            of(lambda: check_lines(passes, told is not None, source), None)
        made = cls(
            name=of(lambda: plan.text("name", default="unnamed"), ""),
            volume=volume,
            lines=tuple(lines or ()),
            feed=of(lambda: plan.feed_or_unknown("feed_m_per_s"), nan),
            sampling=of(lambda: _sampling(plan.section("sampling"), source), Sampling()),
            pause_for_setup=of(lambda: plan.flag("pause_for_setup", default=True), True),
            one_alignment_per_diagonal=of(
                lambda: plan.flag("one_alignment_per_diagonal", default=False), False
            ),
            overrun=of(
                lambda: plan.number("overrun_m", low=0.0, high=LARGEST_OVERRUN, default=0.0), 0.0
            ),
            tracker=None
            if told is None
            else of(lambda: Tracker.from_mapping(told, f"{source}: tracker"), None),
            measurement=of(
                lambda: plan.names("measurement", (STOPS, ON_THE_FLY), default=(STOPS,))[0], STOPS
            ),
        )
        of(plan.finish, None)
        findings.refuse()
        if made.on_the_fly:
            _check_on_the_fly(made, source)
        return made


def _volume(plan: Section) -> Volume:
    findings = Findings()
    nothing = (0.0, 0.0, 0.0)
    origin = findings.of(lambda: plan.vector("origin_m", default=nothing), nothing)
    step = findings.of(lambda: plan.vector("step_m", low=1e-6, high=10.0), nothing)
    blocks = findings.of(lambda: plan.integer("blocks", low=1, high=1000), 1)
    findings.refuse()
    return Volume(origin, step, blocks)


def _lines(plan: Section, volume: Volume, repeats: int, directions: tuple[str, ...]) -> list[Line]:
    findings = Findings()

    def every() -> Iterator[Line]:
        for group in plan.sections("lines"):
            # A group yields its first line when all of it is read.
            try:
                yield from _lines_of_group(group, repeats, directions)
            except ValueError as error:
                findings.found.append(error)

    lines = no_more_than(
        MOST_STOPS,
        _counted_on(every()),
        lambda line: len(line.stops(volume)),
        f"{plan.source}: the lines have more than {MOST_STOPS} stops; make several plans",
    )
    findings.refuse()
    return lines


def _sampling(section: Section, source: str) -> Sampling:
    standard, findings = Sampling(), Findings()

    def number(key: str, default: float, low: float = 0.0, high: float = 1e12) -> float:
        return findings.of(lambda: section.number(key, low, high, default), default)

    def attempts(key: str, default: int) -> int:
        return findings.of(lambda: section.integer(key, 1, 100, default), default)

    after = standard.after_attempts
    sampling = Sampling(
        dwell=number("dwell_s", standard.dwell, high=600.0),
        settle=number("settle_s", standard.settle, high=600.0),
        window=number("window_s", standard.window, low=1e-3, high=600.0),
        longest_wait=number("longest_wait_s", standard.longest_wait, low=1e-3, high=3600.0),
        standard_deviation_limit=number(
            "standard_deviation_limit_m", standard.standard_deviation_limit
        ),
        drift_limit=number("drift_limit_m", standard.drift_limit),
        stop_attempts=attempts("stop_attempts", standard.stop_attempts),
        line_attempts=attempts("line_attempts", standard.line_attempts),
        after_attempts=findings.of(
            lambda: section.names("after_attempts", (HOLD, LEAVE), default=after)[0], after
        ),
    )
    findings.of(section.finish, None)
    findings.refuse()
    if sampling.longest_wait < sampling.settle + sampling.window:
        raise ValueError(
            f"{source}: sampling.longest_wait_s is shorter than settle_s + window_s; "
            "no stop could ever settle"
        )
    return sampling


def _check_on_the_fly(plan: Plan, source: str) -> None:
    """Refuse a plan whose lines cannot be measured on the fly."""
    said = f"{source}: measurement: {ON_THE_FLY}"
    if plan.tracker is not None:
        raise Refusal(
            f"{said} needs a beam that stands still, and this plan has a tracker; use {STOPS}",
            fault="unsupported",
            about="measurement",
        )
    for line in plan.lines:
        moves = len(line.stops(plan.volume)) - 1
        if moves < FEWEST_MOVES:
            raise Refusal(
                f"{said} needs at least {FEWEST_MOVES} moves in a line, and {line.name} has"
                f" {moves}; increase 'blocks', or use {STOPS}",
                fault="too_few",
                about="measurement",
            )


def _counted_on(lines: Iterable[Line]) -> Iterator[Line]:
    """Count the repeats of a line on where it stands in several groups.

    Lines of a tracker are left as they are: two of one name may have different places.
    """
    done: dict[Line, int] = {}
    for line in lines:
        if line.tracked is not None:
            yield line
            continue
        once = replace(line, repeat=0)
        yield replace(line, repeat=done.get(once, 0))
        done[once] = done.get(once, 0) + 1


def _lines_of_group(group: Section, repeats: int, directions: tuple[str, ...]) -> Iterator[Line]:
    kind = group.names("kind", (*LINE_NAMES, TRACKER))[0]
    if kind == TRACKER:
        yield from _tracked_lines(group, repeats, directions)
        return
    names = group.names("names", LINE_NAMES[kind])
    orders: dict[str, tuple[str, ...]] = dict.fromkeys(names, ("",))
    if kind == STEP_DIAGONAL:
        orders = _orders(names, group)
    offset = group.vector("offset_m", default=(0.0, 0.0, 0.0))
    if kind != LINEAR:
        _check_offset(names, offset, group.source)
    mirror_offset = group.vector("mirror_offset_m", low=-1.0, high=1.0, default=(0.0, 0.0, 0.0))
    group_directions = group.names("directions", (FORWARD, BACKWARD), default=directions)
    group_repeats = group.integer("repeats", low=1, high=1000, default=repeats)
    group.finish()
    for name in names:
        for order in orders[name]:
            for repeat in range(group_repeats):
                for direction in group_directions:
                    yield Line(
                        kind,
                        name,
                        order,
                        repeat,
                        direction,
                        offset,
                        mirror_offset=mirror_offset,
                    )


def _tracked_lines(group: Section, repeats: int, directions: tuple[str, ...]) -> Iterator[Line]:
    found = list(lines_of_group(group))
    own_directions = group.names("directions", (FORWARD, BACKWARD), default=directions)
    own_repeats = group.integer("repeats", low=1, high=1000, default=repeats)
    group.finish()
    for name, tracked in found:
        for repeat in range(own_repeats):
            for direction in own_directions:
                yield Line(TRACKER, name, "", repeat, direction, tracked=tracked)


def _orders(names: tuple[str, ...], group: Section) -> dict[str, tuple[str, ...]]:
    """Return the given orders of each step diagonal of a group; by default X before Y before Z."""
    plainest = tuple(dict.fromkeys(move_orders(name)[0] for name in names))
    told = group.names("orders", STEP_ORDERS, default=plainest)
    orders = {name: tuple(one for one in told if one in move_orders(name)) for name in names}
    for name, own in orders.items():
        if not own:
            raise Refusal(
                f"{group.source}: no order in 'orders' is one of {name}; use"
                f" {', '.join(move_orders(name))}",
                fault="mismatch",
            )
    idle = [one for one in told if not any(one in own for own in orders.values())]
    if idle:
        raise Refusal(
            f"{group.source}: the order {idle[0]} moves the axes of none of {', '.join(names)}",
            fault="mismatch",
        )
    return orders


def _check_offset(names: tuple[str, ...], offset: tuple[float, ...], source: str) -> None:
    for name in names:
        for axis, sign, shift in zip(AXES, line_signs(name), offset, strict=True):
            if sign and shift:
                said = f"{source}: offset_m shifts {axis}, which {name} moves along; a diagonal may"
                advice = "be shifted along an axis that stands (give other planes a group of their"
                raise Refusal(f"{said} only {advice} own)", fault="mismatch")
