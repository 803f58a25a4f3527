"""What the lines of a tracker's run come to, station by station, live and from a bag."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.discrepancy.findings import CONSISTENT, NOT_TESTABLE, UNEXPLAINED
from stepdiag_ros.metrology.geometry import AXES, SQUARENESS
from stepdiag_ros.metrology.measurement import MeasuredLine
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.solvers.result import Figure, NotDeterminable, VolumetricErrors
from stepdiag_ros.metrology.solvers.tracker_methods import SEVEN_LINES
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest
from stepdiag_ros.metrology.standards.positioning_uncertainty import UncertaintyDescription
from stepdiag_ros.metrology.tracker.adjustment import PoorGeometry
from stepdiag_ros.metrology.tracker.campaign import points_from
from stepdiag_ros.metrology.tracker.curves import error_curves
from stepdiag_ros.metrology.tracker.evaluation import SevenLineResult, evaluate_test
from stepdiag_ros.metrology.tracker.measured_lines import readings_of
from stepdiag_ros.metrology.tracker.readings import GRID, LOCATE, TrackerReading, stations_of
from stepdiag_ros.metrology.tracker.tracked_line import station_of, test_line_of
from stepdiag_ros.metrology.tracker.verdict import verdict_on


@dataclass(frozen=True)
class StationRun:
    """What was measured from one station.

    Attributes:
        station: its name.
        readings: with one zero of the counter, in order of measurement.
        remarks: what is not among them, in words.
    """

    station: str
    readings: tuple[TrackerReading, ...]
    remarks: tuple[str, ...]


def station_runs(plan: Plan, lines: Iterable[MeasuredLine]) -> tuple[StationRun, ...]:
    """Return the readings of each station that can be evaluated together.

    A pass that lacks a stop is left out: ISO 230-2 needs all targets. So is what was measured after
    the zero was lost, because those lengths count from another, unknown place.

    Args:
        plan: of the run, with a tracker.
        lines: as measured, each with its last attempt.
    """
    lines = tuple(lines)
    whole = [line for line in lines if line.complete or not _straight(plan, line)]
    zeros = stations_of(readings_of(plan, whole))
    made = []
    for station in dict.fromkeys(station_of(line.name) for line in plan.lines):
        own = {name: found for name, found in zeros.items() if name.partition(" #")[0] == station}
        if not own:
            continue
        # The zero with the places that locate the tracker, and of several the one with most lines.
        best = max(own, key=lambda name: (_locates(own[name]), len(own[name])))
        remarks = [
            f"{line.line} lacks a stop and is left out"
            for line in lines
            if not line.complete and _straight(plan, line) and station_of(line.line.name) == station
        ]
        for name, found in own.items():
            if name != best:
                remarks.append(
                    f"{len(found)} readings have another zero (station {name}) and are left out:"
                    " measure them again without losing the beam"
                )
        made.append(StationRun(station, own[best], tuple(remarks)))
    return tuple(made)


def is_grid(plan: Plan) -> bool:
    """Say whether a tracker's plan measures places to multilaterate, and no line."""
    return all(test_line_of(line.name) in (LOCATE, GRID) for line in plan.lines)


def _straight(plan: Plan, line: MeasuredLine) -> bool:
    tracked = plan.lines[line.line_index].tracked
    return tracked is not None and tracked.straight


def _locates(readings: Sequence[TrackerReading]) -> int:
    return sum(one.line == LOCATE for one in readings)


def evaluate_station(
    run: StationRun,
    plan: Plan,
    chain: str,
    description: UncertaintyDescription | None = None,
) -> SevenLineResult:
    """Evaluate the seven lines of one station; see ``evaluation.evaluate_test``.

    Raises:
        PoorGeometry: the tracker cannot be located.
        ValueError: no line was measured, or its runs do not belong together.
    """
    assert plan.tracker is not None
    return evaluate_test(run.readings, description, plan.tracker.minimum_range, chain)


def completes_station(last: MeasuredLine, lines: Iterable[MeasuredLine], plan: Plan) -> bool:
    """Say whether a line is the last of its station that the plan has.

    Args:
        last: the line that was finished.
        lines: all lines so far, ``last`` among them.
        plan: of the run, with a tracker.
    """
    station = station_of(last.line.name)
    wanted = {i for i, line in enumerate(plan.lines) if station_of(line.name) == station}
    return wanted <= {line.line_index for line in lines}


def solve_station(
    last: MeasuredLine, lines: Sequence[MeasuredLine], plan: Plan, chain: str
) -> tuple[VolumetricErrors, tuple[PositioningTest, ...]]:
    """Return the errors and the positioning tests of the station that a line belongs to.

    Raises:
        NotDeterminable: the station is not complete, or its readings do not determine it; states
            why.
    """
    if is_grid(plan):
        return _solve_grid(lines, plan, chain), ()
    station = station_of(last.line.name)
    if not completes_station(last, lines, plan):
        raise NotDeterminable(f"station {station} is not measured to its end", fault="too_few")
    run = next((one for one in station_runs(plan, lines) if one.station == station), None)
    if run is None:
        raise NotDeterminable(f"station {station} has no reading")
    try:
        result = evaluate_station(run, plan, chain)
    except (PoorGeometry, ValueError) as error:
        raise NotDeterminable(f"station {station}: {error}") from None
    errors = errors_of(run, result, lines)
    if errors is None:
        raise NotDeterminable(f"station {station}: {' '.join(result.remarks)}")
    return errors, (result.corrected or result.located).tests


def verdict_on_run(plan: Plan, lines: Sequence[MeasuredLine], chain: str) -> tuple[str, str]:
    """Return the verdict on all stations that are measured, and in words what it rests on.

    Args:
        plan: of the run, with a tracker.
        lines: as measured, each with its last attempt.
        chain: order of the axes from workpiece to tool; empty if not known.
    """
    if is_grid(plan):
        return NOT_TESTABLE, "Places of a grid are measured once: no pass can be compared."
    measured = {line.line_index for line in lines}
    found: list[tuple[str, str]] = []
    for run in station_runs(plan, lines):
        own = {i for i, line in enumerate(plan.lines) if station_of(line.name) == run.station}
        if not own <= measured:
            found.append((NOT_TESTABLE, f"Station {run.station} is not measured to its end."))
            continue
        try:
            name, sentence = verdict_on(evaluate_station(run, plan, chain).joint)
        except ValueError as error:
            name, sentence = NOT_TESTABLE, f"{error}."
        found.append((name, f"Station {run.station}: {sentence}"))
    if not found:
        return NOT_TESTABLE, "No station has a reading."
    for name in (UNEXPLAINED, NOT_TESTABLE):
        if any(one == name for one, _ in found):
            return name, " ".join(sentence for one, sentence in found if one == name)
    return CONSISTENT, " ".join(sentence for _, sentence in found)


def _solve_grid(lines: Sequence[MeasuredLine], plan: Plan, chain: str) -> VolumetricErrors:
    if {line.line_index for line in lines} != set(range(len(plan.lines))):
        raise NotDeterminable("not all stations are measured")
    if not chain:
        raise NotDeterminable("the order of the machine's axes (chain) is not known")
    try:
        return grid_errors(lines, plan, chain)
    except ValueError as error:
        raise NotDeterminable(str(error)) from None


def grid_errors(lines: Iterable[MeasuredLine], plan: Plan, chain: str) -> VolumetricErrors:
    """Return the error curves from the grid of a run with several stations.

    Raises:
        PoorGeometry: too few stations or places, or a station that cannot be located.
    """
    runs = station_runs(plan, lines)
    points = points_from([reading for run in runs for reading in run.readings])
    return error_curves(points, chain)


def errors_of(
    run: StationRun, result: SevenLineResult, lines: Iterable[MeasuredLine]
) -> VolumetricErrors | None:
    """Return the joint estimate of a station as the result of a solver: figures without curves.

    ``positioning E_XX`` is the least-squares line of E_XX over the measured box, at its end.

    Args:
        run: what was measured from the station.
        result: of its seven lines.
        lines: of the whole run, each with its last attempt.

    Returns:
        None if the readings do not allow a joint estimate.
    """
    joint = result.joint
    if joint is None:
        return None
    box, spread = joint.machine.box, joint.standard_uncertainty
    side = np.asarray(box.side)
    figures = [
        Figure(
            f"positioning E_{letter}{letter}",
            float(joint.values[axis] * side[axis]),
            float(spread[axis] * side[axis]),
            "m",
        )
        for axis, letter in enumerate(AXES)
    ]
    figures += [
        Figure(name, float(joint.values[3 + index]), float(spread[3 + index]), "rad")
        for index, name in enumerate(SQUARENESS)
    ]
    ends = np.stack((box.low, box.low + side))
    return VolumetricErrors(
        method=SEVEN_LINES.name,
        nodes=(ends[:, 0], ends[:, 1], ends[:, 2]),
        curves={},
        standard_uncertainty={},
        figures=tuple(figures),
        lines=sum(station_of(line.line.name) == run.station for line in lines),
        chi_squared=float("nan"),
        degrees_of_freedom=0,
        remarks=(*run.remarks, *joint.warnings, *result.remarks),
        frame=joint.machine.frame,
    )
