"""Error curves at the nodes of three axes: what results, error maps and truths have in common."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import AXES, CURVES, Vector, moving_axis
from stepdiag_ros.metrology.refusal import Refusal


@dataclass(frozen=True)
class CurveSet:
    """Error curves under their ISO 230-1 names, each at the nodes of the axis that moves.

    Attributes:
        nodes: machine coordinates of the nodes of X, Y, Z, m, ascending, each shape (nodes of that
            axis,).
        curves: ISO 230-1 name → errors at the nodes of its axis, m (translations) or rad
            (rotations); NaN where not determined. Some or all of ``geometry.CURVES``.
    """

    nodes: tuple[Vector, Vector, Vector]
    curves: Mapping[str, Vector]

    def nodes_of(self, name: str) -> Vector:
        """Return the nodes of the axis whose motion a curve belongs to, m."""
        return self.nodes[moving_axis(name)]


def require_nodes(nodes: Sequence[Vector]) -> None:
    """Check the nodes of X, Y, Z.

    Raises:
        Refusal: an axis does not have two nodes or more, finite and ascending.
    """
    for letter, places in zip(AXES, nodes, strict=True):
        ascending = places.ndim == 1 and len(places) >= 2 and bool(np.all(np.diff(places) > 0))
        if not ascending or not np.all(np.isfinite(places)):
            raise Refusal(
                f"nodes of axis {letter}: expected two or more, ascending", fault="out_of_order"
            )


def require_curve(name: str, values: Vector, nodes: Sequence[Vector]) -> None:
    """Check a curve against the nodes of its axis.

    Raises:
        Refusal: the name is that of no error curve, or there is not one value at each node.
    """
    require_names([name])
    places = nodes[moving_axis(name)]
    if np.shape(values) != places.shape:
        raise Refusal(
            f"{name}: {np.size(values)} values for {len(places)} nodes of {name[3]}",
            fault="mismatch",
        )


def require_names(names: Sequence[str]) -> None:
    """Check that names are those of error curves.

    Raises:
        Refusal: names the first that is not.
    """
    for name in names:
        if name not in CURVES:
            raise Refusal(
                f"'{name}' is not an error curve; use names such as E_XX, E_YX or E_AX",
                fault="unknown",
                aspect="curve",
            )
