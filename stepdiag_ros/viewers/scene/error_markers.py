"""The picture of a result: the measured box, deformed, with its error vectors.

Groups, each of which a viewer can hide: ``box``; for every method ``METHOD/grid`` (the deformed
grid on the box's faces), ``METHOD/vectors``, ``METHOD/scale`` (how long a round error is drawn, and
in which colour), ``METHOD/angles`` (rotations of each axis along the edges from the first corner),
``METHOD/text``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from stepdiag_ros.evaluation.report import Report, short_title
from stepdiag_ros.metrology.forward import rotation_matrices
from stepdiag_ros.metrology.geometry import Vector, places_of
from stepdiag_ros.metrology.plan import Plan, Volume
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.units import IN_MICRO
from stepdiag_ros.viewers.scene.error_map import Extremes, axis_rotations, error_vectors, extremes
from stepdiag_ros.viewers.scene.shapes import (
    GREY,
    WHITE,
    Kind,
    Shape,
    colour,
    ramp,
    round_below,
    spread,
)
from stepdiag_ros.viewers.scene.words import statement

LARGEST_SHARE = 0.2
"""The longest error vector is drawn at most this long, of the box's shortest edge."""
LARGEST_ANGLE = 0.35
"""The largest rotation is drawn at most this large, rad."""
LETTER = 0.04
"""Height of a letter, of the box's shortest edge."""
AXIS_COLOURS = (colour(0.84, 0.37, 0.0), colour(0.0, 0.62, 0.45), colour(0.34, 0.71, 0.91))
"""Of the rods along X, Y, Z: vermilion, bluish green, sky blue (after Okabe & Ito)."""


@dataclass(frozen=True)
class Options:
    """How a result is shown.

    Attributes:
        exaggeration: by which error vectors are drawn longer than they are; 0: a round number, so
            that the longest is at most ``LARGEST_SHARE`` of the box's shortest edge.
        chain: order of the axes from workpiece to tool; empty if it is not known. Angular errors
            need it.
        along_an_edge: how many error vectors are drawn along an edge of the box, at most.
    """

    exaggeration: float = 0.0
    chain: str = ""
    along_an_edge: int = 7


def markers(
    result: VolumetricErrors | None, plan: Plan, options: Options | None = None
) -> tuple[Shape, ...]:
    """Return the picture of one result; without one, the measured box alone.

    Errors that the lines do not determine are not drawn; the text names them.

    Args:
        result: of a solver.
        plan: that was measured.
        options: how it is shown.
    """
    return picture(() if result is None else (result,), plan, options)


def picture(
    results: Sequence[VolumetricErrors], plan: Plan, options: Options | None = None
) -> tuple[Shape, ...]:
    """Return the picture of several results in one box, all exaggerated alike."""
    options = options or Options()
    drawn = [_drawn(result, plan.volume, options) for result in results]
    scale = options.exaggeration or _suitable(drawn, plan.volume)
    shapes = [_box(plan.volume)]
    for place, errors in enumerate(drawn):
        vectors = _vectors(errors, plan.volume, scale)
        angles, enlarged = _angles(errors.result, plan.volume)
        words = statement(errors.result, errors.found, scale if vectors else 0.0, enlarged)
        shapes += _grid(errors, plan.volume, scale, options)
        shapes += vectors
        name = f", {short_title(errors.result.method)}" if len(drawn) > 1 else ""
        shapes += _scale_bar(errors, plan.volume, scale, place, name)
        shapes += angles
        shapes.append(_text(errors.result, plan.volume, words, place))
    return tuple(shapes)


def chosen_results(
    results: Mapping[str, VolumetricErrors], method: str
) -> tuple[VolumetricErrors, ...]:
    """Return the results to be shown, in the order in which methods are shown.

    Args:
        results: by method.
        method: name of one; ``all``; or ``preferred``: the one to rely on of those there are.
    """
    report = Report(tuple(results.values()))
    if method == "preferred":
        preferred = report.preferred()
        return () if preferred is None else (preferred,)
    return tuple(one for one in report.ordered_results() if method in ("all", one.method))


@dataclass(frozen=True)
class _Drawn:
    """The error vectors that are drawn as arrows.

    Attributes:
        result: that they are of.
        found: how large its errors are over all nodes.
        points: nominal, m, shape (n, 3).
        vectors: m, shape (n, 3); NaN where unknown.
        longest: the longest known one, m, of these or of all nodes; 0 if none is known.
    """

    result: VolumetricErrors
    found: Extremes
    points: Vector
    vectors: Vector
    longest: float


def _drawn(result: VolumetricErrors, volume: Volume, options: Options) -> _Drawn:
    found = extremes(result, options.chain)
    chosen = spread(volume.blocks + 1, options.along_an_edge)
    points = places_of([volume.nodes(axis)[chosen] for axis in range(3)])
    vectors = error_vectors(result, options.chain, points)
    sizes = np.linalg.norm(vectors, axis=1)
    known = [*sizes[np.isfinite(sizes)].tolist(), found.accuracy.value]
    longest = max((size for size in known if isfinite(size)), default=0.0)
    return _Drawn(result, found, points, vectors, longest)


def _suitable(drawn: Sequence[_Drawn], volume: Volume) -> float:
    """Return a round factor by which the longest error vector is well seen; 1 if none is known."""
    longest = max((one.longest for one in drawn), default=0.0)
    return round_below(LARGEST_SHARE * _edge(volume) / longest) if longest > 0.0 else 1.0


def _edge(volume: Volume) -> float:
    """Return the shortest edge of the box, m: what sizes of shapes are made from."""
    return min(volume.step) * volume.blocks


def _far_corner(volume: Volume) -> Vector:
    corner: Vector = np.asarray(volume.origin) + np.asarray(volume.step) * volume.blocks
    return corner


def _face_lines(count: int, every: Sequence[int]) -> list[tuple[int, int, int]]:
    """Return the grid lines on the faces of a box: axis, and the nodes of the other two axes."""
    lines = []
    for axis in range(3):
        for one in every:
            for other in every:
                if one in (0, count - 1) or other in (0, count - 1):
                    lines.append((axis, one, other))
    return lines


def _line_points(volume: Volume, axis: int, one: int, other: int) -> Vector:
    """Return the nodes along a grid line of the box, m, shape (nodes, 3)."""
    nodes = [volume.nodes(number) for number in range(3)]
    first, second = (number for number in range(3) if number != axis)
    points = np.empty((volume.blocks + 1, 3))
    points[:, axis] = nodes[axis]
    points[:, first], points[:, second] = nodes[first][one], nodes[second][other]
    return points


def _pairs(points: Vector) -> Vector:
    """Return the ends of the pieces of a path one after another, shape (2(n - 1), …)."""
    return np.repeat(points, 2, axis=0)[1:-1]


def _box(volume: Volume) -> Shape:
    last = volume.blocks
    edges = [
        _line_points(volume, axis, one, other)[[0, -1]]
        for axis, one, other in _face_lines(last + 1, (0, last))
    ]
    width = 0.003 * _edge(volume)
    return Shape("box", 0, Kind.LINES, np.vstack(edges), (width, 0.0, 0.0), GREY)


def _grid(drawn: _Drawn, volume: Volume, scale: float, options: Options) -> tuple[Shape, ...]:
    every = [int(node) for node in spread(volume.blocks + 1, options.along_an_edge)]
    lines = [
        _line_points(volume, axis, one, other)
        for axis, one, other in _face_lines(volume.blocks + 1, every)
    ]
    ends = np.vstack([_pairs(line) for line in lines])
    errors = error_vectors(drawn.result, options.chain, ends)
    # A piece of a line is drawn where both its ends are known.
    known = np.all(np.isfinite(errors), axis=1).reshape(-1, 2).all(axis=1).repeat(2)
    if drawn.longest <= 0.0 or not known.any():
        return ()
    ends, errors = ends[known], errors[known]
    colours = ramp(np.linalg.norm(errors, axis=1) / drawn.longest, 0.85)
    group, size = f"{drawn.result.method}/grid", (0.004 * _edge(volume), 0.0, 0.0)
    return (Shape(group, 0, Kind.LINES, ends + scale * errors, size, colours),)


def _vectors(drawn: _Drawn, volume: Volume, scale: float) -> tuple[Shape, ...]:
    lengths = scale * np.linalg.norm(drawn.vectors, axis=1)
    edge = _edge(volume)
    size = (0.008 * edge, 0.02 * edge, 0.03 * edge)
    shapes = []
    # The number is that of the place, so that an arrow keeps it while others come.
    for number in np.flatnonzero(np.nan_to_num(lengths) > 1e-3 * edge).tolist():
        point, vector = drawn.points[number], scale * drawn.vectors[number]
        shade = ramp(lengths[number : number + 1] / (scale * drawn.longest))
        group = f"{drawn.result.method}/vectors"
        ends = np.stack([point, point + vector])
        shapes.append(Shape(group, number, Kind.ARROW, ends, size, shade))
    return tuple(shapes)


def _scale_bar(
    drawn: _Drawn, volume: Volume, scale: float, place: int, name: str
) -> tuple[Shape, ...]:
    """Return a bar as long as a round error is drawn, in the colours of the errors up to it."""
    if drawn.longest <= 0.0:
        return ()
    shown = round_below(drawn.longest)
    edge = _edge(volume)
    start = np.array(volume.origin)
    start[1] -= (0.15 + 0.12 * place) * edge
    shares = np.linspace(0.0, 1.0, 9)
    points = start + scale * shown * shares[:, None] * np.array([1.0, 0.0, 0.0])
    group, size = f"{drawn.result.method}/scale", (0.015 * edge, 0.0, 0.0)
    label = f"{shown * IN_MICRO:g} µm{name}"
    beside = points[-1] + np.array([0.08 * edge, 0.0, 0.0])
    return (
        Shape(group, 0, Kind.PATH, points, size, ramp(shares * shown / drawn.longest)),
        Shape(group, 1, Kind.TEXT, beside[None, :], (0.0, 0.0, LETTER * edge), WHITE, label),
    )


def _angles(result: VolumetricErrors, volume: Volume) -> tuple[tuple[Shape, ...], float]:
    """Return the rotations of each axis, as rods along X, Y, Z that turn with it, and their scale.

    A rod is drawn where both rotations that tilt it are known.
    """
    points, tilts = [], []
    for axis in range(3):
        places = _line_points(volume, axis, 0, 0)
        chosen = spread(len(places), 7)
        points.append(places[chosen])
        tilts.append(axis_rotations(result, axis)[chosen])
    bases, turns = np.vstack(points), np.vstack(tilts)
    # A rod is not seen to rotate about itself.
    tilting = [np.delete(turns, rod, axis=1) for rod in range(3)]
    known = [np.all(np.isfinite(part), axis=1) for part in tilting]
    seen = np.concatenate([part[rows] for part, rows in zip(tilting, known, strict=True)])
    largest = float(np.max(np.abs(seen), initial=0.0))
    if largest <= 0.0:
        return (), 0.0
    scale = round_below(LARGEST_ANGLE / largest)
    edge = _edge(volume)
    shapes = []
    for rod in range(3):
        turned = scale * np.nan_to_num(turns[known[rod]], nan=0.0)
        base = bases[known[rod]]
        tip = base + 0.1 * edge * rotation_matrices(turned)[:, :, rod]
        if len(base):
            rods = np.stack([base, tip], axis=1).reshape(-1, 3)
            size = (0.006 * edge, 0.0, 0.0)
            group = f"{result.method}/angles"
            shapes.append(Shape(group, rod, Kind.LINES, rods, size, AXIS_COLOURS[rod]))
    return tuple(shapes), scale


def _text(result: VolumetricErrors, volume: Volume, words: str, place: int) -> Shape:
    edge = _edge(volume)
    far, near = _far_corner(volume), np.asarray(volume.origin)
    above = np.array([(near[0] + far[0]) / 2.0, (near[1] + far[1]) / 2.0, far[2]])
    # The text is centred on its place.
    height = 1.3 * LETTER * edge * (words.count("\n") + 1)
    above[2] += 0.15 * edge + 0.5 * height + 0.6 * edge * place
    return Shape(
        f"{result.method}/text",
        0,
        Kind.TEXT,
        above[None, :],
        (0.0, 0.0, LETTER * edge),
        WHITE,
        words,
    )
