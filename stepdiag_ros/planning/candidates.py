"""The plans among which a proposal is sought: boxes, sets of lines, and what each purpose needs."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.checking import FASTEST_FEED
from stepdiag_ros.metrology.geometry import (
    AXES,
    BODY_DIAGONALS,
    FACE_DIAGONALS,
    LINEAR_LINES,
    ROTATIONS,
    SQUARENESS,
    TRANSLATIONS,
    line_signs,
)
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import (
    BACKWARD,
    DIAGONAL,
    FORWARD,
    LINEAR,
    STEP_DIAGONAL,
    Line,
    Volume,
)
from stepdiag_ros.metrology.refusal import Findings, Refusal
from stepdiag_ros.metrology.target import VOLUMETRIC
from stepdiag_ros.planning.expectation import POSITIONING, STRAIGHTNESS, PlanExpectation
from stepdiag_ros.planning.information import STRAIGHTNESS_OF

BLOCKS = (3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100)
"""Numbers of blocks that are tried."""
REPEATS = (1, 2, 3, 5)
"""Numbers of repeats that are tried where no standard fixes one."""
ONE_ORDER = ("XYZ",)
THREE_ORDERS = ("XYZ", "YZX", "ZXY")
"""Of Ibaraki & Hata 2010, section 4.2."""
_SMALLEST_STEP = 1e-4
_FINENESS = (1e-3, 1e-4, 1e-5, 1e-6)
"""Steps are whole multiples of the first of these that wastes less than a hundredth of the box."""
_WASTE = 0.01


@dataclass(frozen=True)
class Group:
    """Lines of one kind at one place.

    Attributes:
        kind: as of ``Line``.
        names: of the lines.
        orders: of a block's moves; one empty text for lines without.
        corner: for each axis 1 if the lines stand at the far end of the box, 0 at its first corner.
    """

    kind: str
    names: tuple[str, ...]
    orders: tuple[str, ...] = ("",)
    corner: tuple[int, int, int] = (0, 0, 0)


@dataclass(frozen=True)
class Scheme:
    """A set of lines.

    Attributes:
        words: what it is, for people.
        groups: in the order of measurement.
        one_alignment: of all move orders of a diagonal.
    """

    words: str
    groups: tuple[Group, ...]
    one_alignment: bool = False


LINEAR_AXES = Group(LINEAR, LINEAR_LINES)
FOUR_DIAGONALS = Group(STEP_DIAGONAL, BODY_DIAGONALS, ONE_ORDER)
_FOUR_IN_THREE_ORDERS = Group(STEP_DIAGONAL, BODY_DIAGONALS, THREE_ORDERS)
_BODY = Group(DIAGONAL, BODY_DIAGONALS)
_FACES = Group(DIAGONAL, FACE_DIAGONALS)


def edge_line(name: str, axis: int) -> Group:
    """Return a linear line that stands at the far end of another axis's travel."""
    x, y, z = (int(other == axis) for other in range(3))
    return Group(LINEAR, (name,), corner=(x, y, z))


EDGE_LINES = tuple(
    edge_line(name, axis)
    for number, name in enumerate(LINEAR_LINES)
    for axis in range(3)
    if axis != number
)
"""Each linear line at the far end of each of the two other axes: levers for the rotations."""

_ANGULAR_SCHEMES = (
    Scheme("4 step diagonals in 3 orders, each with its own alignment", (_FOUR_IN_THREE_ORDERS,)),
    Scheme(
        "4 step diagonals in 3 orders, one alignment each",
        (_FOUR_IN_THREE_ORDERS,),
        one_alignment=True,
    ),
    Scheme(
        "4 step diagonals in 3 orders, linear axes at 2 edges",
        (*EDGE_LINES, _FOUR_IN_THREE_ORDERS),
        one_alignment=True,
    ),
    Scheme(
        "4 step diagonals in 3 orders, linear axes at corner and 2 edges",
        (LINEAR_AXES, *EDGE_LINES, _FOUR_IN_THREE_ORDERS),
        one_alignment=True,
    ),
)


@dataclass(frozen=True)
class PlanPurpose:
    """What a plan is for.

    Attributes:
        words: for people.
        target: name of the quantity whose uncertainty counts, for people.
        needed: names of what the plan must determine; empty: as many as any candidate does.
        unit: of the target, ``m`` or ``rad``.
        kinds: of lines among which an exchange seeks the plan; empty: one of ``schemes`` is taken.
        schemes: sets of lines that are tried, where a standard or a model prescribes them.
        spacing: largest distance between nodes of an axis as a share of the longest side of the
            box, or, if a standard fixes it, in ``spacing_m``.
        spacing_m: largest distance between targets along a line, m; inf if ``spacing`` counts.
        repeats: numbers of repeats that are tried.
        directions: of every line.
        overrun: lines begin with an overrun, so that every stop is approached in their direction.
        rotations: the model has the nine rotations in it.
    """

    words: str
    target: str
    needed: tuple[str, ...]
    unit: str
    kinds: tuple[str, ...] = ()
    schemes: tuple[Scheme, ...] = ()
    spacing: float = math.inf
    spacing_m: float = math.inf
    repeats: tuple[int, ...] = REPEATS
    directions: tuple[str, ...] = (FORWARD, BACKWARD)
    overrun: bool = False
    rotations: bool = False

    @property
    def figures(self) -> tuple[str, ...]:
        """Return the names of the quantities whose largest uncertainty counts."""
        return (VOLUMETRIC,) if VOLUMETRIC in self.needed else self.needed or tuple(ROTATIONS)


def of_expectation(expectation: PlanExpectation, names: Iterable[str]) -> dict[str, float]:
    """Return expected standard uncertainties by name, SI.

    Args:
        expectation: of a plan.
        names: as of ``Information``.
    """
    known = {
        **expectation.squareness,
        **{STRAIGHTNESS_OF + name: u for name, u in expectation.straightness.items()},
        **expectation.positioning,
        **expectation.angular,
        VOLUMETRIC: expectation.volumetric,
    }
    return {name: known[name] for name in names}


_FIVE_PER_METRE = 0.2
_FIVE_RUNS = (5,)

PURPOSES: dict[str, PlanPurpose] = {
    "squareness": PlanPurpose(
        "squareness of the three axes",
        "the squareness",
        SQUARENESS,
        "rad",
        kinds=(LINEAR, DIAGONAL),
        spacing=0.26,
    ),
    "straightness": PlanPurpose(
        "the six straightness deviations",
        "the straightness",
        tuple(STRAIGHTNESS_OF + name for name in STRAIGHTNESS),
        "m",
        kinds=(LINEAR, STEP_DIAGONAL),
        spacing=0.1,
    ),
    "volumetric": PlanPurpose(
        "all nine translational errors, to correct a machine with",
        "the error of the mirror's point anywhere in the box",
        (*TRANSLATIONS, *SQUARENESS, VOLUMETRIC),
        "m",
        kinds=(LINEAR, STEP_DIAGONAL),
        spacing=0.1,
    ),
    "angular": PlanPurpose(
        "the angular errors, as many as a laser interferometer determines",
        "the angular errors",
        (),
        "rad",
        schemes=_ANGULAR_SCHEMES,
        spacing=0.1,
        rotations=True,
    ),
    "iso230-2": PlanPurpose(
        "positioning accuracy and repeatability of each axis, ISO 230-2",
        "the positioning",
        POSITIONING,
        "m",
        schemes=(Scheme("linear axes, 5 bidirectional runs", (LINEAR_AXES,)),),
        spacing_m=_FIVE_PER_METRE,
        repeats=_FIVE_RUNS,
        overrun=True,
    ),
    "iso230-6": PlanPurpose(
        "diagonal displacement tests, ISO 230-6",
        "the squareness",
        SQUARENESS,
        "rad",
        schemes=(
            Scheme("4 body diagonals, 5 bidirectional runs", (_BODY,)),
            Scheme("4 body and 6 face diagonals, 5 bidirectional runs", (_BODY, _FACES)),
        ),
        spacing_m=_FIVE_PER_METRE,
        repeats=_FIVE_RUNS,
        overrun=True,
    ),
    "quick": PlanPurpose(
        "a first look at all nine translational errors",
        "the error of the mirror's point anywhere in the box",
        (*TRANSLATIONS, VOLUMETRIC),
        "m",
        kinds=(LINEAR, STEP_DIAGONAL),
        spacing=0.26,
        repeats=(1,),
        directions=(FORWARD,),
    ),
}
"""Name on the command line → purpose."""


TRAVEL_ACCELERATION = 1.0
"""Assumed of an axis of which only the travel is known, m/s²."""


def travel_machine(
    travel: Sequence[float], chain: str = "", acceleration: float | None = None
) -> Machine:
    """Return a machine of which only the travel is known; its coordinates begin at 0.

    Args:
        travel: of X, Y, Z, m.
        chain: order of the axes from workpiece to tool; empty if not known.
        acceleration: of an axis, m/s²; ``TRAVEL_ACCELERATION`` if None.
    """
    x, y, z = (float(length) for length in travel)
    return Machine(
        name=f"travel {x * 1e3:g} x {y * 1e3:g} x {z * 1e3:g} mm",
        chain=chain,
        travel_low_m=(0.0, 0.0, 0.0),
        travel_high_m=(x, y, z),
        feed_limit_m_per_s=FASTEST_FEED,
        acceleration_m_per_s2=acceleration or TRAVEL_ACCELERATION,
    )


def travel_box(
    machine: Machine,
    margin: float,
    low: Sequence[float] | None = None,
    high: Sequence[float] | None = None,
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return the two corners of the box that is measured, m.

    Args:
        machine: its travel.
        margin: kept free at every end of the travel, m.
        low: first corner that the user wants; the travel's, less the margin, if None.
        high: last corner that the user wants.

    Raises:
        ValueError: the box is empty, or it leaves the travel; names the axis.
    """
    corners, findings = [], Findings()
    for axis, letter in enumerate(AXES):
        ends = machine.travel_low_m[axis], machine.travel_high_m[axis]
        first = ends[0] + margin if low is None else low[axis]
        last = ends[1] - margin if high is None else high[axis]
        if first >= last:
            words = (
                f"no box is left along {letter}: from {first:g} m to {last:g} m; "
                "take a smaller margin or another box"
            )
            findings.found.append(Refusal(words, fault="too_few"))
        elif first < ends[0] + margin - 1e-12 or last > ends[1] - margin + 1e-12:
            words = (
                f"the box runs {letter} from {first:g} m to {last:g} m, but with a margin of "
                f"{margin:g} m the travel is {ends[0] + margin:g} m to {ends[1] - margin:g} m"
            )
            findings.found.append(Refusal(words, fault="out_of_range", aspect="box"))
        corners.append((first, last))
    findings.refuse()
    (x0, x1), (y0, y1), (z0, z1) = corners
    return (x0, y0, z0), (x1, y1, z1)


def volume_in(
    low: tuple[float, float, float], high: tuple[float, float, float], blocks: int
) -> Volume:
    """Return the largest volume of so many blocks in a box, with round steps, in its middle.

    Raises:
        ValueError: a step would be smaller than anything that makes sense to measure.
    """
    steps, origins = [], []
    for first, last, letter in zip(low, high, AXES, strict=True):
        exact = (last - first) / blocks
        if exact < _SMALLEST_STEP:
            raise ValueError(f"{blocks} blocks along {letter} are steps of {exact * 1e3:g} mm")
        # A whole number of thousandths, tenths … of a millimetre, and as a float the nearest to it.
        fine = next((fine for fine in _FINENESS if exact % fine <= _WASTE * exact), _FINENESS[-1])
        step = round(math.floor(exact / fine + 1e-9) * fine, 9)
        left = (last - first) - step * blocks
        origin = first + math.floor(left / 2.0 / fine + 1e-9) * fine
        steps.append(step)
        origins.append(round(origin, 9) + 0.0)
    return Volume((origins[0], origins[1], origins[2]), (steps[0], steps[1], steps[2]), blocks)


def lines_of(
    scheme: Scheme, volume: Volume, repeats: int, directions: tuple[str, ...]
) -> tuple[Line, ...]:
    """Return the lines of a scheme in a volume, in the order in which a plan file makes them."""
    lines = []
    for group in scheme.groups:
        x, y, z = (
            round(far * step * volume.blocks, 9)
            for far, step in zip(group.corner, volume.step, strict=True)
        )
        for name in group.names:
            for order in group.orders:
                for repeat in range(repeats):
                    for direction in directions:
                        lines.append(Line(group.kind, name, order, repeat, direction, (x, y, z)))
    return tuple(lines)


def target_spacing(lines: Iterable[Line], volume: Volume) -> float:
    """Return the largest distance between targets along some lines, m."""
    step = np.asarray(volume.step)
    largest = 0.0
    for line in lines:
        moved = step[line_signs(line.name) != 0]
        along = np.linalg.norm(moved) if line.kind == DIAGONAL else np.max(moved)
        largest = max(largest, float(along))
    return largest
