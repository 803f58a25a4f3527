"""A method: everything that commands, pages, schemas and pictures know of one solver."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.observations import Observations
from stepdiag_ros.metrology.solvers.result import VolumetricErrors

if TYPE_CHECKING:
    from stepdiag_ros.metrology.solvers.monte_carlo import Estimator

Solver = Callable[[Measurement], VolumetricErrors]


@dataclass(frozen=True)
class Method:
    """One way from readings to errors. A module of this package declares its own as ``METHOD``.

    Attributes:
        name: in commands, parameters and documents, such as ``least_squares``; the ``method`` of
            its results.
        title: for people; what stands before a parenthesis is the title of a narrow column.
        summary: what it does, in one line without a full stop.
        needs: what must be measured, in one line without a full stop.
        source: document and equations.
        solve: the solver; None where the readings are not displacements along a standing beam.
        order: place among the methods, from the plainest to the one that uses everything.
        reliance: how far to rely on a result beside those of other methods; results are shown from
            the lowest to the highest, and the highest is preferred. 0: never preferred.
        curves: ISO 230-1 names of the curves that every result holds.
        free_curves: number of curves of which each value is free, in matrices that hold all of them
            (see ``limits``); 0 for a method without a limit of size.
        weighs_direct: it uses what was measured directly.
        takes_setup_as_perfect: errors of laser and mirror go into its curves, often far beyond the
            errors of the machine; pictures have scales of their own for it.
        estimator: makes the method ready for many sets of readings at once, for budgets; None if
            there is no such form of it.
    """

    name: str
    title: str
    summary: str
    needs: str
    source: str
    solve: Solver | None
    order: int = 1000
    reliance: int = 0
    curves: tuple[str, ...] = ()
    free_curves: int = 0
    weighs_direct: bool = False
    takes_setup_as_perfect: bool = False
    estimator: "Callable[[Measurement, Observations], Estimator] | None" = None
