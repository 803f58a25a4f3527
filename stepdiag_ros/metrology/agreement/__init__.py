"""Do two measurements of one machine agree, and if not, what has changed and by how much.

Each value of the second is set against that of the first with the uncertainty of their difference:
the normalised error E_n (ISO 13528:2022, 9.7; ISO/IEC 17043), and for a whole curve one statistic
that knows how its nodes hang together (chi squared with its probability by chance). Whether
anything has changed is judged by all of them at once.
"""

from stepdiag_ros.metrology.agreement.changes import CurveChange, MachineChanges, compare
from stepdiag_ros.metrology.agreement.joint import SIGNIFICANT, JointTest, joint_test
from stepdiag_ros.metrology.agreement.judgement import OF_CURVES, Family, JointJudgement
from stepdiag_ros.metrology.agreement.measured import ComparedMeasurement
from stepdiag_ros.metrology.agreement.shared import SAME_INSTRUMENT, SAME_MACHINE
from stepdiag_ros.metrology.agreement.values import FAMILIES, REVERSAL, FigureChange, PlaceChange

__all__ = [
    "FAMILIES",
    "OF_CURVES",
    "REVERSAL",
    "SAME_INSTRUMENT",
    "SAME_MACHINE",
    "SIGNIFICANT",
    "ComparedMeasurement",
    "CurveChange",
    "Family",
    "FigureChange",
    "JointJudgement",
    "JointTest",
    "MachineChanges",
    "PlaceChange",
    "compare",
    "joint_test",
]
