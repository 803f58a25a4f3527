"""Bidirectional runs along one line: the data that ISO 230-2 and ISO 230-6 evaluate.

A positional deviation is x_ij = P_ij - P_i: the reading less the commanded displacement, at target
i in run j, for each direction of approach. All parameters of both standards are differences of
deviations, so the zero of the interferometer is free, as long as all runs of a test share it.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, LINEAR_LINES, Vector, beam_direction, line_signs
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement, latest_attempts
from stepdiag_ros.metrology.plan import DIAGONAL, FORWARD, LINEAR, STEP_DIAGONAL, Plan, Volume
from stepdiag_ros.metrology.refusal import Refusal

ON_THE_DIAGONAL_BY_STEPS = (
    "taken from step diagonals at the ends of their blocks, which lie on the diagonal: each axis"
    " comes from the same side as in a move along the diagonal, and a tilted mirror changes"
    " nothing there to first order; but the axes moved one after another, not together"
)
NO_OVERRUN = (
    "nothing says that the runs begin beyond the end targets (overrun), so these may not have been"
    " approached from both sides: the reversal error there may be too small"
)

WITHOUT_OVERRUN = (
    "the runs begin at the end targets, not beyond them (no overrun), so these may not have been"
    " approached from both sides: the reversal error there may be too small"
)
STEPS_BEGIN_AT_THE_END = (
    "a run of steps begins at its end target (only lines along an axis or a diagonal have an"
    " overrun), so that this target is not approached from both sides: the reversal error there may"
    " be too small"
)
_ENDS_IN_DOUBT = {NO_OVERRUN, WITHOUT_OVERRUN, STEPS_BEGIN_AT_THE_END}


@dataclass(frozen=True)
class BidirectionalRuns:
    """Deviations of one line, run by run.

    Attributes:
        name: of the line: X, Y, Z for an axis, else of the diagonal such as ppp or np0.
        kind: ``plan.LINEAR``, ``plan.DIAGONAL`` or ``plan.STEP_DIAGONAL``.
        target: positions of the targets along the line, ascending, m, shape (m,): coordinates of
            the axis, or distances from a diagonal's start.
        forward: deviations in runs that approach the targets ascending, m, shape (n, m).
        backward: the same for runs the other way round, in the order of ``target``; shape (0, m)
            if there are none.
        setup: identity of alignment and zero that the runs share.
        remarks: what the reader must know of the data, in words.

    Raises:
        ValueError: shapes that do not fit, values that are not finite, targets that do not ascend,
            or no run at all.
    """

    name: str
    kind: str
    target: Vector
    forward: Vector
    backward: Vector
    setup: str = ""
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.target.ndim != 1 or len(self.target) < 2 or not np.all(np.diff(self.target) > 0):
            raise Refusal(
                f"test of {self.name}: expected two or more targets, ascending",
                fault="out_of_order",
            )
        for direction, runs in (("forward", self.forward), ("backward", self.backward)):
            if runs.ndim != 2 or runs.shape[1] != len(self.target):
                raise Refusal(
                    f"test of {self.name}: the {direction} runs do not have one deviation for each"
                    f" of {len(self.target)} targets",
                    fault="mismatch",
                )
            if not np.all(np.isfinite(runs)):
                raise Refusal(
                    f"test of {self.name}: a {direction} deviation is not finite",
                    fault="out_of_range",
                    aspect="deviation",
                )
        if len(self.forward) + len(self.backward) == 0:
            raise Refusal(f"test of {self.name}: there is no run", fault="too_few")

    @property
    def length(self) -> float:
        """Return the measured length: from the first to the last target, m."""
        return float(self.target[-1] - self.target[0])

    @property
    def ends_in_doubt(self) -> bool:
        """Say whether the end targets may not have been approached from both sides."""
        return not _ENDS_IN_DOUBT.isdisjoint(self.remarks)


def all_runs(measurement: Measurement) -> tuple[BidirectionalRuns, ...]:
    """Return the tests in a measurement, one for each line that was measured in one setup.

    Linear lines are tests of an axis (ISO 230-2), diagonals those of ISO 230-6. A step diagonal
    counts at the ends of its blocks: these lie on the diagonal, so that the term d·(q - q_0) of a
    tilted mirror vanishes (d is perpendicular to the beam, see ``metrology.forward``), and every
    axis arrives there in the sense in which a move along the diagonal brings it. Runs with a
    rejected stop are left out and named.

    Raises:
        ValueError: runs of one setup have different targets.
    """
    groups: dict[tuple[str, str, str, str], list[MeasuredLine]] = {}
    for line in measurement.lines:
        key = (line.setup, line.line.kind, line.line.name, line.line.order)
        groups.setdefault(key, []).append(line)
    return tuple(
        test
        for lines in groups.values()
        if (test := runs_of(lines, measurement.volume)) is not None
    )


def completed_by(
    last: MeasuredLine, lines: tuple[MeasuredLine, ...], plan: Plan
) -> BidirectionalRuns | None:
    """Return the test that a line completes; None as long as passes of the plan are missing.

    Args:
        last: the line that was finished.
        lines: all lines so far, every attempt, ``last`` among them.
        plan: of the run.
    """
    wanted = {
        index
        for index, line in enumerate(plan.lines)
        if (line.kind, line.name, line.order) == (last.line.kind, last.line.name, last.line.order)
        and plan.setup_of(line) == last.setup
    }
    passes = [line for line in latest_attempts(lines) if line.line_index in wanted]
    if not wanted or {line.line_index for line in passes} != wanted:
        return None
    return runs_of(passes, plan.volume)


def begun(lines: tuple[MeasuredLine, ...], plan: Plan) -> tuple[BidirectionalRuns, ...]:
    """Return the tests of which a run that has ended measured some passes, but not all.

    Args:
        lines: all lines of the run, every attempt.
        plan: of the run.
    """
    last = {
        (line.setup, line.line.kind, line.line.name, line.line.order): line
        for line in latest_attempts(lines)
    }
    left = [line for line in last.values() if completed_by(line, lines, plan) is None]
    keys = {(line.setup, line.line.kind, line.line.name) for line in left}
    found = all_runs(Measurement(plan.volume, latest_attempts(lines)))
    return tuple(one for one in found if (one.setup, one.kind, _line_name(one)) in keys)


def _line_name(test: BidirectionalRuns) -> str:
    return LINEAR_LINES[AXES.index(test.name)] if test.kind == LINEAR else test.name


def runs_of(lines: Iterable[MeasuredLine], volume: Volume) -> BidirectionalRuns | None:
    """Return the runs along one line in one setup; None if none of them is complete.

    Args:
        lines: at least one; all of the same kind, name, order and setup.
        volume: the measured box.

    Raises:
        ValueError: the lines have different targets.
    """
    lines = tuple(lines)
    line = lines[0].line
    direction = beam_direction(line.name, np.asarray(volume.step))
    every = int(np.count_nonzero(line_signs(line.name))) if line.kind == STEP_DIAGONAL else 1
    forward: list[Vector] = []
    backward: list[Vector] = []
    remarks: list[str] = []
    targets: Vector | None = None
    for one in lines:
        onward = one.line.direction == FORWARD
        order = slice(None) if onward else slice(None, None, -1)
        places, readings = one.target[order][::every], one.displacement[order][::every]
        if targets is None:
            targets = places
        if places.shape != targets.shape or np.max(np.abs(places - targets)) > 1e-9:
            raise ValueError(f"{one.line}: its targets are not those of {lines[0].line}")
        if not np.all(np.isfinite(readings)):
            remarks.append(f"{one.line} is left out: a stop has no value")
            continue
        deviations = readings - (places - lines[0].target[0]) @ direction
        (forward if onward else backward).append(deviations)
    if targets is None or not forward + backward:
        return None
    if line.kind == LINEAR:
        axis = LINEAR_LINES.index(line.name)
        name, along = AXES[axis], targets[:, axis].copy()
    else:
        name, along = line.name, (targets - targets[0]) @ direction
    if line.kind == STEP_DIAGONAL:
        remarks.append(ON_THE_DIAGONAL_BY_STEPS)
    if forward and backward and not all(one.overrun > 0.0 for one in lines):
        unknown = any(np.isnan(one.overrun) for one in lines)
        at_the_end = STEPS_BEGIN_AT_THE_END if line.kind == STEP_DIAGONAL else WITHOUT_OVERRUN
        remarks.append(NO_OVERRUN if unknown else at_the_end)
    empty = np.empty((0, len(along)))
    return BidirectionalRuns(
        name=name,
        kind=line.kind,
        target=along,
        forward=np.array(forward) if forward else empty,
        backward=np.array(backward) if backward else empty,
        setup=lines[0].setup,
        remarks=tuple(remarks),
    )


def is_diagonal(kind: str) -> bool:
    """Say whether a line of this kind is tested by ISO 230-6 (else by ISO 230-2)."""
    return kind in (DIAGONAL, STEP_DIAGONAL)
