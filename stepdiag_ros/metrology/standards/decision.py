"""What a supervisor decides on: the largest error, whether it is permissible, what else acts."""

from dataclasses import dataclass
from enum import IntEnum

from stepdiag_ros.metrology.standards.conformity import Conformity
from stepdiag_ros.metrology.target import TargetStanding


class Agreement(IntEnum):
    """Verdict of the diagnosis; the numbers are DIAGNOSIS_* of RunVerdict.msg."""

    UNKNOWN = 0
    CONSISTENT = 1
    NAMED = 2
    AMBIGUOUS = 3
    UNEXPLAINED = 4
    NOT_TESTABLE = 5
    DESCRIBED = 6


@dataclass(frozen=True)
class RunDecision:
    """What a supervisor decides on.

    Attributes:
        conformity: of the largest error with the tolerance (ISO 14253-1).
        diagnosis: whether run and model of the machine agree.
        worst_error: length of the longest error vector in the measured box, m; NaN if unknown.
        expanded_uncertainty: of it (95 %), m; NaN if unknown.
        coverage_factor: of this uncertainty.
        budgeted: it is no smaller than U by the uncertainty budget.
        upper_bound: no error in the volume is larger (95 %), m; NaN if unknown.
        worst_place: machine coordinates of the place, m.
        tolerance: m; NaN if none was agreed.
        method: that determined the errors; empty if none did.
        not_determined: names of the error curves (of nine) and squareness errors that are unknown.
        target: how far the run is from its target; None if it has none.
    """

    conformity: Conformity
    diagnosis: Agreement
    worst_error: float
    expanded_uncertainty: float
    coverage_factor: float
    budgeted: bool
    upper_bound: float
    worst_place: tuple[float, float, float]
    tolerance: float
    method: str
    not_determined: tuple[str, ...]
    target: TargetStanding | None = None
