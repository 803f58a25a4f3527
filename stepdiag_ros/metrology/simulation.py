"""Simulation of a measurement at its stops: no drives, no servo, fast enough for Monte Carlo."""

from dataclasses import replace

import numpy as np

from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.forward import Alignment
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import FORWARD, Line, Plan
from stepdiag_ros.metrology.refusal import Refusal


def simulate(
    plan: Plan, cell: SimulatedCell, seed: int = 0, readings_per_stop: int = 1
) -> Measurement:
    """Measure a plan on a simulated cell.

    The air is taken as compensated and every stop as settled. The noise of a stop is that of the
    mean of independent readings; a setup's readings share one alignment and one zero, that of its
    first stop. The cell's effects act on the readings before these are zeroed.

    Args:
        plan: what is measured.
        cell: the true errors.
        seed: of the noise; the cell's own seed fixes curves and misalignment.
        readings_per_stop: number of readings in the mean of a stop, at least 1.

    Returns:
        the lines in the order of the plan, with the true standard uncertainty of every stop.

    Raises:
        ValueError: fewer than one reading a stop, an effect that cannot act in this plan, or a stop
            where the cell's errors are not given.
    """
    if readings_per_stop < 1:
        raise Refusal(
            f"readings_per_stop is {readings_per_stop}; expected 1 or more", fault="out_of_range"
        )
    noise = cell.reading_noise / np.sqrt(readings_per_stop)
    return read_again(planned_run(plan, cell), cell, noise, seed)


def planned_run(plan: Plan, cell: SimulatedCell) -> Measurement:
    """Return a run as it would be made by a plan: every stop, its time and its air, read as zero.

    Args:
        plan: what is to be measured; travel at its feed, dwell at each stop.
        cell: whose chain and weather these are.
    """
    made = []
    time = 0.0
    for index, line in enumerate(plan.lines):
        targets = line.stops(plan.volume)
        times = stop_times(line, plan, time)
        time = float(times[-1]) + plan.sampling.dwell
        made.append(
            MeasuredLine(
                line=line,
                line_index=index,
                attempt=1,
                setup=plan.setup_of(line),
                time=times,
                end_time=round(float(times[-1]) * 1e9),
                target=targets,
                displacement=np.zeros(len(targets)),
                standard_uncertainty=np.zeros(len(targets)),
                environment=np.array([cell.environment(float(moment)) for moment in times]),
                overrun=plan.overrun_of(line),
            )
        )
    return Measurement(volume=plan.volume, lines=tuple(made), chain=cell.chain)


def read_again(
    run: Measurement, cell: SimulatedCell, noise: float = 0.0, seed: int = 0
) -> Measurement:
    """Return what a simulated cell would have read in a run: same stops, times and weather.

    Args:
        run: that was made or planned; a setup that lost its zero (``… (zero 2)``) keeps its
            alignment. Stops without a value stay without.
        cell: the true errors; its effects act at the times and in the weather of the run.
        noise: standard deviation of the reading of a stop, m.
        seed: of the noise.

    Returns:
        the run with other readings, each setup's counted from its first, and their uncertainty.

    Raises:
        ValueError: an effect cannot act in this run; or the run has no line; or a stop is where the
            cell's errors are not given.
    """
    rng = np.random.default_rng(seed)
    alignments: dict[str, Alignment] = {}
    lines = []
    for line in run.lines:
        setup = line.setup.partition(" (zero ")[0]
        if setup not in alignments:
            # The laser stands before the forward pass's first stop, whichever pass comes first.
            start = replace(line.line, direction=FORWARD).stops(run.volume)[0]
            alignments[setup] = cell.alignment(
                setup, line.line.name, run.volume.step, start, line.line.mirror_offset
            )
        cell.require(line.target, f"line {line.line.name}")
        readings = cell.displacement(line.target, alignments[setup], line.line.mirror_offset)
        readings = readings + noise * rng.standard_normal(len(line.target))
        lines.append(
            replace(
                line,
                displacement=np.where(np.isfinite(line.displacement), readings, np.nan),
                standard_uncertainty=np.full(len(line.target), noise),
            )
        )
    measurement = _zeroed(replace(run, lines=tuple(lines)))
    return _zeroed(_affected(measurement, cell)) if cell.effects else measurement


def _zeroed(measurement: Measurement) -> Measurement:
    """Return the measurement with every setup's readings counted from its first."""
    zeros: dict[str, float] = {}
    lines = []
    for line in measurement.lines:
        read = line.displacement[np.isfinite(line.displacement)]
        if read.size:
            zeros.setdefault(line.setup, float(read[0]))
        lines.append(replace(line, displacement=line.displacement - zeros.get(line.setup, np.nan)))
    return replace(measurement, lines=tuple(lines))


def _affected(measurement: Measurement, cell: SimulatedCell) -> Measurement:
    """Return the measurement with what the cell's effects add to its readings."""
    stops = stops_of(measurement)
    change = np.sum([effect.readings(stops) for effect in cell.effects], axis=0)
    ends = np.cumsum([len(line.time) for line in measurement.lines])
    lines = tuple(
        replace(line, displacement=line.displacement + added)
        for line, added in zip(measurement.lines, np.split(change, ends[:-1]), strict=True)
    )
    return replace(measurement, lines=lines)


def stop_times(line: Line, plan: Plan, start: float) -> Vector:
    """Return when each stop of a line is read: travel at the plan's feed, then the dwell, s."""
    targets = line.stops(plan.volume)
    travel = np.linalg.norm(np.diff(targets, axis=0, prepend=targets[:1]), axis=1) / plan.feed
    if plan.run_up(line) is not None:
        travel[0] += 2.0 * plan.overrun / plan.feed
    times: Vector = start + np.cumsum(travel + plan.sampling.dwell)
    return times
