"""Where simulation and data disagree, which effect is missing, and whether it closes the gap."""

from stepdiag_ros.metrology.discrepancy.diagnose import diagnose
from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    CONSISTENT,
    DESCRIBED,
    NAMED,
    NOT_TESTABLE,
    UNEXPLAINED,
    Candidate,
    Diagnosis,
    Finding,
    RunnerUp,
    Share,
)

__all__ = [
    "AMBIGUOUS",
    "CONSISTENT",
    "DESCRIBED",
    "NAMED",
    "NOT_TESTABLE",
    "UNEXPLAINED",
    "Candidate",
    "Diagnosis",
    "Finding",
    "RunnerUp",
    "Share",
    "diagnose",
]
