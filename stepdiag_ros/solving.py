"""Solving in the way that makes a live run, its replay and its bag agree to the last bit."""

from threadpoolctl import ThreadpoolController

from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers import solve_all
from stepdiag_ros.metrology.solvers.result import VolumetricErrors


def solve_reproducibly(
    measurement: Measurement,
) -> tuple[dict[str, VolumetricErrors], dict[str, str]]:
    """Solve by every method; see ``metrology.solvers.solve_all``.

    Sums that several threads share come out differently with the number of threads, in their last
    bits. One thread is fast enough for these matrices, and gives the same numbers wherever the same
    numerical libraries run on the same kind of processor.

    Raises:
        ValueError: the lines contradict each other or the volume.
    """
    with ThreadpoolController().limit(limits=1, user_api="blas"):
        return solve_all(measurement)
