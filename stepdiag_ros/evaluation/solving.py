"""Solving in the way that makes a live run, its replay and its bag agree bit for bit."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from threadpoolctl import ThreadpoolController

from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.solvers import solve_all
from stepdiag_ros.metrology.solvers.result import NotDeterminable, VolumetricErrors
from stepdiag_ros.metrology.solvers.tracker_methods import SEVEN_LINES
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest


@dataclass(frozen=True)
class SolvedSoFar:
    """What the lines so far have come to.

    Attributes:
        results: method → errors.
        refused: method → why these lines are not enough for it.
        tests: of positioning, where the method makes them itself.
    """

    results: dict[str, VolumetricErrors]
    refused: dict[str, str]
    tests: tuple[PositioningTest, ...] = field(default=())


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep the numerical libraries to one thread while the block runs.

    Sums that several threads share come out differently with the number of threads, in their last
    bits. One thread is fast enough for the matrices of a run, and gives the same numbers wherever
    the same numerical libraries run on the same kind of processor. Several threads wait for each
    other actively: where another process draws pictures meanwhile, a decomposition of 3 ms takes
    a second.
    """
    with ThreadpoolController().limit(limits=1, user_api="blas"):
        yield


def solve_reproducibly(
    measurement: Measurement,
) -> tuple[dict[str, VolumetricErrors], dict[str, str]]:
    """Solve by every method, with one thread; see ``metrology.solvers.solve_all``.

    Raises:
        ValueError: the lines contradict each other or the volume.
    """
    with one_thread():
        return solve_all(measurement)


def solve_run(plan: Plan, measurement: Measurement, last: MeasuredLine) -> SolvedSoFar:
    """Solve what there is of a run after one of its lines, as the plan's kind of line needs it.

    Args:
        plan: of the run.
        measurement: the lines so far, each with its last attempt.
        last: the line that was finished.

    Raises:
        ValueError: the lines contradict each other or the volume.
    """
    if plan.tracker is None:
        return SolvedSoFar(*solve_reproducibly(measurement))
    # Only here: few runs are made with a tracker.
    from stepdiag_ros.metrology.tracker.run_result import solve_station

    with one_thread():
        try:
            result, tests = solve_station(last, measurement.lines, plan, measurement.chain)
        except NotDeterminable as why:
            return SolvedSoFar({}, {SEVEN_LINES.name: str(why)})
    return SolvedSoFar({result.method: result}, {}, tests)
