"""The moves of a whole plan in order: what the sequencer will command, before it does."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from stepdiag_ros.metrology.geometry import AXES, LINEAR_LINES, Vector
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import DIAGONAL, Line, Plan
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.units import IN_MILLI
from stepdiag_ros.planning.mirror import mirror_width
from stepdiag_ros.planning.nc_writing import Dialect, Move, nc_program
from stepdiag_ros.run.feasibility import beyond_machine

Point = tuple[float, float, float]


@dataclass(frozen=True)
class DrivenLine:
    """One line of a plan as it is driven.

    Attributes:
        line: which.
        setup: identity of its alignment.
        new_setup: laser and mirror are aligned before it.
        targets: to which the machine goes, m; those before the first stop only bring it there.
        stops: how many of the last targets are stops.
        back: how many of the first targets lead back along the line before, in the beam.
    """

    line: Line
    setup: str
    new_setup: bool
    targets: tuple[Point, ...]
    stops: int
    back: int = 0


def passes_of(plan: Plan) -> Iterator[DrivenLine]:
    """Go over the lines of a plan in order.

    As the sequencer does, an alignment is made again whenever the setup is not that of the line
    before.
    """
    aligned = ""
    known: dict[Line, tuple[tuple[Point, ...], int]] = {}
    for index, line in enumerate(plan.lines):
        setup = plan.setup_of(line)
        # Repeats go the same way.
        way = replace(line, repeat=0)
        if way not in known:
            stops = [_point(stop) for stop in line.stops(plan.volume)]
            beyond = plan.run_up(line)
            # To the first stop, beyond it along the line, and back: the beam is kept.
            run_up = [] if beyond is None else [stops[0], _point(beyond)]
            known[way] = (*run_up, *stops), len(stops)
        targets, count = known[way]
        back = tuple(_point(place) for place in plan.way_back(index))
        yield DrivenLine(line, setup, setup != aligned, (*back, *targets), count, len(back))
        aligned = setup


def dwell_of(plan: Plan) -> float:
    """Return how long a stop takes at least, s: its dwell, or the window that is averaged."""
    sampling = plan.sampling
    return max(sampling.dwell, sampling.settle + sampling.window)


def moves_of(plan: Plan) -> list[Move]:
    """Return the moves of a plan, with the program stops for alignment.

    Between lines the axes move one at a time, X before Y before Z, as the sequencer has it. Before
    a new setup the program stops twice: where the line before ended, until the way is clear, and at
    the first stop, where laser and mirror are aligned.
    """
    moves: list[Move] = []
    dwell = dwell_of(plan)
    for number, one in enumerate(passes_of(plan), start=1):
        first_stop = len(one.targets) - one.stops
        way = describe(one.line).replace(f", repeat {one.line.repeat}", "")
        title = f"Pass {number} of {len(plan.lines)}: {way}"
        align = ""
        if one.new_setup:
            clear = f"Clear the way to the first stop of pass {number} for tool, mirror and cable"
            moves.append(Move(one.targets[0], 0.0, program_stop=clear))
            align = _alignment_words(one, first_stop)
        for index, target in enumerate(one.targets):
            moves.append(
                Move(
                    target_m=target,
                    dwell_s=dwell if index >= first_stop else 0.0,
                    comment=title if index == 0 else "",
                    # Going to the line is not part of it, and is done one axis at a time.
                    at_once=one.line.kind == DIAGONAL and (index > 0 or one.back > 0),
                    program_stop=align if index == 0 else "",
                )
            )
    return moves


def program_of(plan: Plan, machine: Machine, dialect: Dialect | None = None) -> str:
    """Write the NC program of a plan.

    Args:
        plan: what is measured.
        machine: whose travel and feed the plan must keep within.
        dialect: of the controller; the default ``Dialect`` if None.

    Raises:
        ValueError: the machine cannot execute the plan, or it cannot be written; one sentence.
    """
    beyond = beyond_machine(plan, machine)
    if beyond:
        raise Refusal(f"no NC program: {beyond}", fault="out_of_range", aspect="move")
    return nc_program(
        moves_of(plan),
        feed_m_per_s=plan.feed,
        name=plan.name,
        remarks=(
            f"Machine: {machine.name}",
            f"{len(plan.lines)} passes, {plan.stop_count} stops; the laser is read during each "
            "dwell, M0 before each new alignment",
            *_mirror_words(plan),
        ),
        dialect=dialect,
    )


def _mirror_words(plan: Plan) -> list[str]:
    """Say how wide the mirror must be; nothing where no line moves it sideways."""
    width = mirror_width(plan)
    wider = f"The mirror must be at least {width * IN_MILLI:.1f} mm wider than the beam"
    return [wider] if width else []


def describe(line: Line) -> str:
    """Say which pass a line is and where: ``x forward, repeat 1, shifted by 0, 100, 0 mm``."""
    if not any(line.offset):
        return str(line)
    shift = ", ".join(f"{value * IN_MILLI:g}" for value in line.offset)
    return f"{replace(line, offset=(0.0, 0.0, 0.0))}, shifted by {shift} mm"


def _alignment_words(one: DrivenLine, first_stop: int) -> str:
    """Say what is aligned, along which axes, and through which place of the machine."""
    place = " ".join(
        f"{axis} {value * IN_MILLI:g}"
        for axis, value in zip(AXES, one.targets[first_stop], strict=True)
    )
    name = one.setup.partition("@")[0].strip()
    return f"Align laser and mirror for {name}, {beam_words(one.line)} from {place} mm"


def beam_words(line: Line) -> str:
    """Say in words along which axes the beam of a line runs."""
    if line.name in LINEAR_LINES:
        return f"beam along +{line.name.upper()}"
    signs = {"p": "+", "n": "-"}
    axes = [signs[c] + axis for c, axis in zip(line.name, AXES, strict=True) if c in signs]
    return "beam along " + " ".join(axes)


def _point(position: Vector) -> Point:
    return float(position[0]), float(position[1]), float(position[2])
