"""The two sign definitions of squareness, by the short names under which a user chooses one.

A result holds squareness as a right-handed rotation; ``metrology.forward`` says what that means and
how the other definition follows from it.
"""

from typing import Literal

from stepdiag_ros.metrology.forward import OVER_90_DEGREES, RIGHT_HANDED, SQUARENESS_DEFINITIONS
from stepdiag_ros.metrology.table_one import Entry, TableOneRow

SignDefinition = Literal["rotation", "angle"]

SIGN_DEFINITIONS: dict[SignDefinition, str] = {
    "rotation": RIGHT_HANDED,
    "angle": OVER_90_DEGREES,
}
LEAST_SQUARES_LINES = (
    "Squareness is that of the least-squares lines through the axes' motions; lines through their"
    " end points, as of diagonals alone ('stepdiag squareness'), give other values where the"
    " motions are curved."
)


def sign(name: str, definition: SignDefinition) -> float:
    """Return +1 or -1: the factor from the value of a result to the value in a sign definition.

    Raises:
        KeyError: the name is not a squareness.
    """
    return SQUARENESS_DEFINITIONS[SIGN_DEFINITIONS[definition]][name]


def angle_of(row: TableOneRow, entry: Entry) -> float:
    """Return the right-handed rotation (rad) of a squareness that Table 1 gives over the travel."""
    from stepdiag_ros.metrology.forward import SQUARENESS_SLOPES

    return SQUARENESS_SLOPES[row.name][0] * entry.value / row.travel
