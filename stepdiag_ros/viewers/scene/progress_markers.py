"""The picture of a measurement while it goes on: lines, laser, beam and mirror.

Groups: ``lines``, ``line_names``, ``stations`` (places of a tracker), ``laser``, ``beam``,
``mirror``. Places of a tracker that do not follow each other are crosses. A line keeps its number,
the order in which the plan first comes to it, through the whole run.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from stepdiag_ros.metrology.frames import (
    LASER,
    MIRROR,
    Placement,
    Triple,
    beam_length,
    first_stop,
    mirror_on_tool,
    setup_placements,
)
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.plan import Line, Plan, Volume
from stepdiag_ros.metrology.tracker.tracked_line import station_of
from stepdiag_ros.viewers.scene.shapes import (
    GREY,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILION,
    WHITE,
    Kind,
    Shape,
    colour,
)


@dataclass(frozen=True)
class LineCourse:
    """A line in space, which several passes go along.

    Attributes:
        line: one of its passes, forward or backward.
        passes: numbers of all of them in the plan.
    """

    line: Line
    passes: tuple[int, ...]

    @property
    def name(self) -> str:
        """Return its name with the order of moves, as people say it."""
        return f"{self.line.name} {self.line.order}".strip()

    @property
    def along_a_line(self) -> bool:
        """Say whether its stops follow each other; single places of a tracker do not."""
        return self.line.tracked is None or self.line.tracked.straight


def courses(plan: Plan) -> tuple[LineCourse, ...]:
    """Return the lines in space of a plan, in the order in which it first comes to them."""
    found: dict[tuple[str, str, str, Triple, Triple], list[int]] = {}
    for number, line in enumerate(plan.lines):
        key = line.kind, line.name, line.order, line.offset, line.mirror_offset
        found.setdefault(key, []).append(number)
    return tuple(LineCourse(plan.lines[passes[0]], tuple(passes)) for passes in found.values())


@dataclass(frozen=True)
class DrawnProgress:
    """How far a measurement is.

    Attributes:
        measured: number of a pass in the plan → whether all its stops have a value.
        present: the pass that is measured now; None if none is.
        position: actual position of the tool, m; None if it is not known.
        laser_distance: from the laser to the mirror at the first stop of a line, m.
        mirror_offset: of the mirror from the tool point, m.
    """

    measured: Mapping[int, bool] = field(default_factory=dict)
    present: int | None = None
    position: Triple | None = None
    laser_distance: float = 0.3
    mirror_offset: Triple = (0.0, 0.0, 0.0)


def progress_markers(plan: Plan, progress: DrawnProgress) -> tuple[Shape, ...]:
    """Return the picture of a measurement that goes on.

    To do: grey; being measured: orange; every pass done: sky blue; a pass without all its stops:
    vermilion.

    Args:
        plan: that is measured.
        progress: how far.
    """
    edge = min(plan.volume.step) * plan.volume.blocks
    shapes: list[Shape] = list(_stations(plan, edge, progress.mirror_offset))
    ends: dict[Triple, list[str]] = {}
    for number, course in enumerate(courses(plan)):
        stops = course.line.stops(plan.volume)
        done = [one for one in course.passes if one in progress.measured]
        shade, width = _look(course, progress)
        size = (width * edge, 0.0, 0.0)
        if course.along_a_line:
            shapes.append(Shape("lines", number, Kind.PATH, stops, size, shade))
            first = first_stop(course.line, plan.volume)
            last = stops[0] if np.array_equal(stops[-1], first) else stops[-1]
            beyond = last + 0.06 * edge * (last - first) / float(np.linalg.norm(last - first))
        else:
            crosses = _crosses(stops, 0.02 * edge)
            shapes.append(Shape("lines", number, Kind.LINES, crosses, size, shade))
            beyond = stops[0] + np.array([0.0, 0.0, 0.06 * edge])
        x, y, z = (float(part) for part in beyond)
        label = f"{course.name}  {len(done)}/{len(course.passes)}"
        ends.setdefault((x, y, z), []).append(label)
    for number, (place, labels) in enumerate(ends.items()):
        size = (0.0, 0.0, 0.035 * edge)
        at = np.array([place])
        shapes.append(Shape("line_names", number, Kind.TEXT, at, size, WHITE, "\n".join(labels)))
    if progress.present is not None:
        line = plan.lines[progress.present]
        laser, _ = setup_placements(
            line, plan.volume, progress.laser_distance, progress.mirror_offset
        )
        station = None if line.tracked is None else np.array(line.tracked.station)
        there = replace(progress, mirror_offset=mirror_on_tool(line, progress.mirror_offset))
        shapes.extend(_optics(laser, plan.volume, there, station))
    return tuple(shapes)


def _stations(plan: Plan, edge: float, offset: Triple) -> Iterator[Shape]:
    """Yield a box and a name for each place of a tracker; nothing of other plans."""
    # A station is where the axes would stand if the reflector met the tracker.
    places = {
        station_of(line.name): np.array([line.tracked.station]) + np.array(offset)
        for line in plan.lines
        if line.tracked is not None
    }
    body, name = (0.1 * edge, 0.1 * edge, 0.1 * edge), (0.0, 0.0, 0.035 * edge)
    for number, (station, place) in enumerate(places.items()):
        yield Shape("stations", 2 * number, Kind.BOX, place, body, GREY)
        above = place + np.array([0.0, 0.0, 0.1 * edge])
        text = f"station {station}"
        yield Shape("stations", 2 * number + 1, Kind.TEXT, above, name, WHITE, text)


def _crosses(places: Vector, arm: float) -> Vector:
    """Return a small cross along X, Y and Z at each place as pairs of points, m, shape (6n, 3)."""
    arms = arm * np.eye(3)
    ends = np.stack((places[:, None] - arms, places[:, None] + arms), axis=2)
    pairs: Vector = ends.reshape(-1, 3)
    return pairs


def _look(course: LineCourse, progress: DrawnProgress) -> tuple[Vector, float]:
    """Return colour and width (of the box's shortest edge) of a line."""
    measured = [progress.measured[one] for one in course.passes if one in progress.measured]
    if progress.present in course.passes:
        return ORANGE, 0.014
    if not all(measured):
        return VERMILION, 0.010
    if len(measured) == len(course.passes):
        return SKY_BLUE, 0.008
    return GREY, 0.005


def _optics(
    laser: Placement, volume: Volume, progress: DrawnProgress, station: Vector | None
) -> tuple[Shape, ...]:
    """Return laser, mirror and beam.

    Args:
        laser: where it is.
        volume: the measured box.
        progress: how far the measurement is.
        station: of a tracker, whose beam follows the reflector, m, shape (3,); None: the beam
            stands still.
    """
    edge = min(volume.step) * volume.blocks
    origin = np.zeros((1, 3))
    body = np.array([[-0.1 * edge, 0.0, 0.0]])
    shapes = [
        Shape(
            "laser",
            0,
            Kind.BOX,
            body,
            (0.2 * edge, 0.08 * edge, 0.08 * edge),
            colour(0.55, 0.55, 0.6),
            frame=LASER,
        ),
        Shape(
            "mirror",
            0,
            Kind.BOX,
            origin,
            (0.01 * edge, 0.12 * edge, 0.12 * edge),
            colour(0.9, 0.9, 0.95, 0.9),
            frame=MIRROR,
        ),
    ]
    size = (0.006 * edge, 0.0, 0.0)
    if progress.position is not None and station is not None:
        ends = np.stack((station, np.asarray(progress.position)))
        shapes.append(
            Shape("beam", 0, Kind.LINES, ends + np.asarray(progress.mirror_offset), size, PURPLE)
        )
    elif progress.position is not None:
        # The mirror's plane sends the beam back on itself wherever the mirror has moved sideways.
        reach = beam_length(laser, progress.position, progress.mirror_offset)
        beam = np.array([[0.0, 0.0, 0.0], [reach, 0.0, 0.0]])
        shapes.append(Shape("beam", 0, Kind.LINES, beam, size, PURPLE, frame=LASER))
    return tuple(shapes)
