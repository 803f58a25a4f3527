"""The methods whose readings are a tracker's lengths; ``metrology.tracker`` solves them."""

from stepdiag_ros.metrology.solvers.method import Method

SEVEN_LINES = Method(
    name="seven_lines",
    title="Seven lines (tracker)",
    summary="positioning, straightness and squareness from seven lines of a tracker",
    needs="seven lines of one station",
    source="ATLI",
    solve=None,
    order=70,
    reliance=7,
)
MULTILATERATION = Method(
    name="multilateration",
    title="Multilateration (tracker)",
    summary="all rigid-body errors from the lengths of several stations of a tracker",
    needs="a grid of places seen from several stations",
    source="ATLI",
    solve=None,
    order=80,
    reliance=8,
)
