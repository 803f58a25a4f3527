"""Several runs of one machine as one measurement, so that a diagnosis uses all of them at once.

What the runs share and what they do not:

- The error curves are the machine's and are shared, and so is every effect of the catalogue that
  is a property of the machine: one size for all runs.
- Alignments, zeros, repeats, slips and breaks belong to one run. Each setup and each pass keeps the
  number of its run, so that an effect that is tied to one names it (``run 2: ppp XYZ``); those of
  the first run keep their names.
- Between two runs the machine has another temperature, and its axes other lengths: 1 K is 11 µm on
  a metre, a hundred times the noise. Each axis has a free scale in each run after the first
  (``run_scales``, fitted with the baseline); else every pair of days would show a thermal growth.
- Time counts from the start of each run: what warms up does so again. Where it goes on instead,
from
  one run to the next without a rest, a steady growth differs by a scale only, which is free.
"""

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, Vector
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import Volume, of_run
from stepdiag_ros.metrology.refusal import Refusal

_BY_STOP = tuple(
    one.name
    for one in fields(Stops)
    if one.name not in ("chain", "corner", "travel", "pass_index", "setup", "lines", "setups")
)
_SAME_PLACE = 1e-4
"""Share of a step by which nodes of two runs may differ: rounding of tables."""


def joined(measurements: Sequence[Measurement], names: Sequence[str] = ()) -> Measurement:
    """Put several runs of one machine together.

    Args:
        measurements: the runs, in the order in which they were made. A run that is itself several
            runs counts as so many.
        names: of the runs, for the text of a refusal; their numbers if empty.

    Returns:
        one measurement over the volume of the first run, in the chain that any of them states.

    Raises:
        ValueError: no run, a run without lines, or one of another volume or chain; names the run
            and what differs.
    """
    if not measurements:
        raise Refusal(
            "there is no run to be diagnosed; give at least one", fault="too_few", aspect="run"
        )
    chain = require_one_machine(measurements, names)
    lines: list[MeasuredLine] = []
    before = 0
    for measurement in measurements:
        place = 1 + max((line.line_index for line in lines), default=-1)
        lines += [_moved(line, before, place) for line in measurement.lines]
        before = max(line.line.run for line in lines)
    return Measurement(measurements[0].volume, tuple(lines), chain)


def require_one_machine(measurements: Sequence[Measurement], names: Sequence[str] = ()) -> str:
    """Refuse runs that cannot be of one machine over one box; return its chain.

    Args:
        measurements: the runs, at least one.
        names: of the runs, for the text of a refusal; their numbers if empty.

    Returns:
        order of the axes from workpiece to tool; empty if no run states it.

    Raises:
        ValueError: a run without lines, or one of another volume or chain; names the run and what
            differs.
    """
    words = [
        names[index] if index < len(names) else f"run {index + 1}"
        for index in range(len(measurements))
    ]
    chain, chain_from = "", ""
    for name, measurement in zip(words, measurements, strict=True):
        if not measurement.lines:
            raise Refusal(
                f"{name} has no measured line; leave it out", fault="too_few", aspect="line"
            )
        _check_volume(measurements[0].volume, measurement.volume, words[0], name)
        if measurement.chain and chain and measurement.chain != chain:
            raise Refusal(
                f"{name} is of a machine with the chain {measurement.chain}, {chain_from} of one"
                f" with {chain}; only runs of the same machine can be diagnosed together",
                fault="mismatch",
            )
        if measurement.chain and not chain:
            chain, chain_from = measurement.chain, name
    return chain


def _moved(line: MeasuredLine, runs: int, place: int) -> MeasuredLine:
    """Return a line as one of a later run, behind other lines."""
    if not runs:
        return line
    own = line.setup.removeprefix(of_run("", line.line.run))
    run = line.line.run + runs
    return replace(
        line,
        line=replace(line.line, run=run),
        line_index=line.line_index + place,
        setup=of_run(own, run),
    )


def appended(stops: Stops, further: Stops) -> Stops:
    """Return the stops of one or several runs, followed by those of a later one.

    Args:
        stops: of the earlier runs.
        further: of the later one, its lines numbered as that run (``Line.run``), over the same box.
    """
    rows = {
        name: np.concatenate([getattr(stops, name), getattr(further, name)]) for name in _BY_STOP
    }
    return Stops(
        chain=stops.chain,
        corner=stops.corner,
        travel=stops.travel,
        pass_index=np.concatenate([stops.pass_index, further.pass_index + len(stops.lines)]),
        setup=np.concatenate([stops.setup, further.setup + len(stops.setups)]),
        lines=(*stops.lines, *further.lines),
        setups=(*stops.setups, *further.setups),
        **rows,
    )


def _check_volume(one: Volume, other: Volume, first: str, name: str) -> None:
    if one.blocks != other.blocks:
        raise Refusal(
            f"{name} has {other.blocks} blocks, {first} has {one.blocks}; runs can only be"
            " diagnosed together if they share all nodes, since the error curves are known there",
            fault="mismatch",
        )
    for axis, letter in enumerate(AXES):
        apart = float(np.max(np.abs(other.nodes(axis) - one.nodes(axis))))
        if apart > _SAME_PLACE * one.step[axis]:
            raise Refusal(
                f"{name} has other nodes of {letter} than {first}: from {other.nodes(axis)[0]:g} to"
                f" {other.nodes(axis)[-1]:g} m, not from {one.nodes(axis)[0]:g} to"
                f" {one.nodes(axis)[-1]:g} m; runs can only be diagnosed together if they share"
                " all nodes, since the error curves are known there",
                fault="mismatch",
            )


def run_scales(stops: Stops) -> Vector:
    """Return what a unit of the free scale of each axis in each later run adds to each reading.

    Args:
        stops: of one run or of several.

    Returns:
        m, shape (n, 3·(runs - 1)), without columns of axes that do not move in a run; no column
        where there is one run.
    """
    columns = [
        np.where(stops.run == run, stops.direction[:, axis] * stops.position[:, axis], 0.0)
        for run in np.unique(stops.run)[1:]
        for axis in range(len(AXES))
    ]
    moved = [column for column in columns if np.any(column)]
    made: Vector = np.column_stack(moved) if moved else np.zeros((len(stops.time), 0))
    return made
