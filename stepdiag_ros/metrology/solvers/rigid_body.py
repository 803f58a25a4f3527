"""All eighteen error curves of the rigid-body model at once, in one weighted least squares.

Unknowns: nine translations and nine rotations, free at every node; two angles for every diagonal
setup; one zero for every pass. The model is that of ``forward`` (Ibaraki & Hata 2010, eq. 23, for
any chain) with the effective direction of each setup exact; ``design`` derives it.

Reference point: the curves are those of the mirror's point with the other axes at the first corner
of the measured box, zero at the first node. The mirror's offset, the machine's zero and the dead
path need not be known, as long as the beam meets that point of the mirror at the first stop of a
line's forward sense. A beam that misses it by b ⊥ n adds Σ (ε_i × n)·b to its line, 0.02 µm for
1 mm and 20 µrad: as much as the rotations' own course over the line, so it bends the curves by this
and not more.

Frame: that of Ibaraki & Hata 2010, eq. 17: E_YX, E_ZX and E_YZ end at zero.

Much of the eighteen curves cannot be determined: the straightness of an axis at this point,
for instance, only as far as its rotations. What is not determined is NaN and named with what can do
the same; see ``visibility`` for the same before measuring.
"""

from stepdiag_ros.metrology.geometry import CURVES, TRANSLATIONS
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.design import Design
from stepdiag_ros.metrology.solvers.least_squares import solve_design
from stepdiag_ros.metrology.solvers.method import Method
from stepdiag_ros.metrology.solvers.monte_carlo import Estimator, LeastSquaresEstimator
from stepdiag_ros.metrology.solvers.observations import Observations, observe
from stepdiag_ros.metrology.solvers.result import NotDeterminable, VolumetricErrors


def solve_rigid_body(measurement: Measurement) -> VolumetricErrors:
    """Estimate translations and rotations from any lines of a machine whose chain is known.

    Uncertainties, unknown noise and too large residuals are treated as in ``least_squares``.

    Raises:
        NotDeterminable: the chain is not known, or there is no reading at all.
        ValueError: the lines contradict the volume or each other, or an axis stands between nodes
            on a face diagonal where its rotation counts.
    """
    _require_chain(measurement)
    design = Design(observe(measurement), measurement.chain)
    return solve_design("rigid_body", design, measurement.plausible)


def _estimator(measurement: Measurement, observations: Observations) -> Estimator:
    _require_chain(measurement)
    return LeastSquaresEstimator(measurement, observations, rotations=True)


def _require_chain(measurement: Measurement) -> None:
    if not measurement.chain:
        raise NotDeterminable(
            "needs the order of the machine's axes from workpiece to tool (chain), which is not "
            "known for this measurement",
            fault="missing",
            aspect="chain",
        )


METHOD = Method(
    name="rigid_body",
    title="Rigid body (all 21 errors)",
    summary="all eighteen curves and squareness at once, by weighted least squares",
    needs="any lines, and the chain of the axes",
    source="IH eq. 23, for any chain",
    solve=solve_rigid_body,
    order=60,
    reliance=5,
    curves=TRANSLATIONS,
    free_curves=len(CURVES),
    weighs_direct=True,
    estimator=_estimator,
)
