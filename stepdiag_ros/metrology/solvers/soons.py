"""Angular errors from three orders of the moves (Soons 2005; Ibaraki & Hata 2010, section 3.3).

A move of one axis j, repeated after another axis i has gone on by one interval, gives another
displacement only if the two axes turn: to first order the difference is

    R_j(after i) - R_j(before i) = a_j (Δε_i × n)·ê_j       where j stands before i in the chain,

with n the beam's unit vector, Δε_i the change of the three rotations of axis i over its interval,
and both displacements counted along +j. Translations, positions and the alignment, if it is the
same in both, drop out. (Where i stands before j the same holds with i and j exchanged, so
that each pair of axes determines the later one alone.)

For a chain c1 c2 c3 from workpiece to tool, five of the nine rotations follow: those of c2 about c2
and c3, from the pair (c1, c2) on two diagonals, and all three of c3, from (c2, c3) on two diagonals
and (c1, c3) on one. For ``YXZ`` with pnp and npp these are IH eqs. (24)-(28) for unequal steps. No
step diagonal shows the three rotations of c1, nor that of c2 about c1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.geometry import (
    AXES,
    CHAINS,
    ROTATIONS,
    Vector,
    beam_direction,
    line_signs,
    moving_axis,
)
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.linear import DIAGONALS, noise_of
from stepdiag_ros.metrology.solvers.method import Method
from stepdiag_ros.metrology.solvers.observations import Observations, observe
from stepdiag_ros.metrology.solvers.ranges import range_excess
from stepdiag_ros.metrology.solvers.result import Figure, NotDeterminable, VolumetricErrors
from stepdiag_ros.metrology.solvers.summary import deviations_from_line

ANGULAR_FRAME = (
    "each angle is zero at the first node of its axis; a translation of the axes before it, a turn "
    "of the whole frame and the point that the mirror stands at do not change it"
)
ONE_ALIGNMENT = "one_alignment_per_diagonal: true"
"""Key of a plan by which the three orders of a diagonal share alignment and zero."""


Place = tuple[int, int, tuple[int, ...]]
"""Of a single-axis move: the axis, its interval, the nodes at which the other two axes stand."""


class Equation(NamedTuple):
    """One of the five differences of displacements.

    Attributes:
        earlier: axis j whose move is compared, the earlier one in the chain.
        later: axis i that goes on in between; its rotations are seen.
        line: the diagonal.
    """

    earlier: int
    later: int
    line: str


@dataclass(frozen=True)
class AngleUncertainty:
    """What an uncertainty of single displacements does to an angle (IH eq. 29 and what follows it).

    Attributes:
        worst_per_block: all displacements err by the uncertainty in the worst directions, rad.
        standard_per_block: they err independently with it as standard uncertainty, rad.
        worst_over_travel: worst over all blocks, rad.
        standard_over_travel: independent over all blocks, rad.
    """

    worst_per_block: float
    standard_per_block: float
    worst_over_travel: float
    standard_over_travel: float


def equations_of(chain: str) -> tuple[Equation, ...]:
    """Return the five differences that determine five rotations, in the order of IH (24) to (28).

    The pair (c1, c2) needs two diagonals on which the signs of c2 and c3 differ in their product,
    the pair (c2, c3) two on which those of c1 and c3 do. Of ppp, npp and pnp those two serve whose
    product of the signs of c1 and c2 is the same: npp and pnp where c3 is Z, as in IH, else ppp
    and another.

    Raises:
        ValueError: no such chain.
    """
    if chain not in CHAINS:
        raise Refusal(
            f"'{chain}' is not a kinematic chain; use one of {', '.join(CHAINS)}", fault="unknown"
        )
    first, second, third = (AXES.index(letter) for letter in chain)
    same = {
        line: int(line_signs(line)[first] * line_signs(line)[second]) for line in DIAGONALS[::-1]
    }
    one, other = next((a, b) for a in same for b in same if a != b and same[a] == same[b])
    return (
        Equation(first, second, one),
        Equation(second, third, one),
        Equation(first, second, other),
        Equation(first, third, other),
        Equation(second, third, other),
    )


def angles_seen(chain: str) -> tuple[str, ...]:
    """Return the names of the five rotations from the three orders, in the order of c2, c3."""
    first, second, third = tuple(chain)
    return tuple(
        name
        for letter in (second, third)
        for name in ROTATIONS
        if name[3] == letter and not (letter == second and AXES["ABC".index(name[2])] == first)
    )


def angles_not_seen(chain: str) -> tuple[str, ...]:
    """Return the names of the four rotations that no step diagonal determines."""
    return tuple(name for name in ROTATIONS if name not in angles_seen(chain))


def matrix_of_equations(chain: str, step: Vector) -> Vector:
    """Return the coefficients of the five angles in the five differences, m/rad, shape (5, 5).

    Rows as in ``equations_of``, columns as in ``angles_seen``; the entry is a_j (ê_k × n)·ê_j for
    the rotation about axis k.

    Args:
        chain: order of the axes from workpiece to tool.
        step: size of one block along X, Y, Z in m, shape (3,).
    """
    names = angles_seen(chain)
    matrix = np.zeros((5, 5))
    for row, (earlier, later, line) in enumerate(equations_of(chain)):
        beam = beam_direction(line, step)
        for column, name in enumerate(names):
            if AXES.index(name[3]) == later:
                about = np.eye(3)["ABC".index(name[2])]
                matrix[row, column] = step[earlier] * np.cross(about, beam)[earlier]
    return matrix


def angle_uncertainty(
    volume: Volume, chain: str, displacement_uncertainty: float
) -> dict[str, AngleUncertainty]:
    """Return what an uncertainty of every single displacement means for the five angles.

    IH eq. (29): with 0.1 µm in a block of a = 10 mm the worst case of E_AX is 3.5e-5 rad per block
    and 4.2e-4 rad over 12 blocks. The worst case adds absolute values, as IH do; the standard
    uncertainty takes the displacements as independent.

    Args:
        volume: the measured box.
        chain: order of the axes from workpiece to tool.
        displacement_uncertainty: of one single-axis move's displacement along the beam, m.
    """
    inverse = np.linalg.inv(matrix_of_equations(chain, np.asarray(volume.step)))
    # Every difference is made of two displacements, and no two differences share one.
    worst = 2.0 * np.sum(np.abs(inverse), axis=1) * displacement_uncertainty
    standard = np.sqrt(2.0 * np.sum(inverse**2, axis=1)) * displacement_uncertainty
    return {
        name: AngleUncertainty(
            float(worst[row]),
            float(standard[row]),
            float(volume.blocks * worst[row]),
            float(np.sqrt(volume.blocks) * standard[row]),
        )
        for row, name in enumerate(angles_seen(chain))
    }


def solve_soons(measurement: Measurement) -> VolumetricErrors:
    """Solve the five differences of ``equations_of`` for the five rotations, interval by interval.

    IH take the three orders of a diagonal as measured in one alignment: it drops out of every
    difference. Where each order was aligned again (lines of different setups), the difference of
    the alignments is a constant in each equation, so that every curve is known but for a straight
    line through its first node: then curves are not given, only their shapes as figures ``shape
    E_AX`` … (largest minus smallest deviation from the least-squares line). With one alignment the
    result also has ``angular E_AX`` … (largest minus smallest value).

    Right to the first order of the angular errors. The covariance is propagated from the readings,
    also those that successive intervals share.

    Raises:
        NotDeterminable: the chain is not known; a diagonal is missing; the orders of its moves do
            not give both displacements of an equation.
        ValueError: the lines contradict the volume; the chain does not exist.
    """
    chain = measurement.chain
    if not chain:
        raise NotDeterminable(
            "needs the kinematic chain of the machine, which is not known for this measurement",
            fault="missing",
            aspect="chain",
        )
    equations = equations_of(chain)
    observations = observe(measurement)
    volume = observations.volume
    needed = tuple(dict.fromkeys(equation.line for equation in equations))
    names = np.array([setup.line for setup in observations.setups])[observations.setup]
    missing = [line for line in needed if line not in names]
    if missing:
        raise NotDeterminable(
            f"needs {' and '.join(needed)} in three orders of the moves for the chain {chain}; "
            f"missing: {', '.join(missing)}",
            fault="missing",
            aspect="orders",
        )
    inverse = np.linalg.inv(matrix_of_equations(chain, np.asarray(volume.step)))
    increments = np.tensordot(inverse, _differences(observations, equations, names), axes=1)
    matrix = np.zeros((len(increments), volume.blocks + 1, len(names)))
    np.cumsum(increments, axis=1, out=matrix[:, 1:])
    del increments  # as large as the matrix
    shared = all(len(np.unique(observations.setup[names == line])) == 1 for line in needed)
    used = np.isin(names, needed)
    return _result(observations, chain, matrix, shared, len(set(observations.passes[used])))


def _differences(
    observations: Observations, equations: Sequence[Equation], names: NDArray[np.str_]
) -> Vector:
    """Return ``_difference`` of all equations, shape (5, blocks, n); ``names``: of the lines."""
    lines = {equation.line for equation in equations}
    moves = {line: _moves(observations, names == line) for line in lines}
    return np.stack([_difference(moves, one, observations.volume) for one in equations])


def _moves(observations: Observations, here: NDArray[np.bool_]) -> dict[Place, Vector]:
    """Return the mean displacement of every single-axis move on a line.

    Args:
        observations: the readings.
        here: which of them are on the line, shape (n,).

    Returns:
        place of the move → weights on the readings of its displacement along the positive axis,
        shape (n,).
    """
    count = len(observations.displacement)
    before = np.flatnonzero(
        here[:-1]
        & here[1:]
        & (observations.passes[:-1] == observations.passes[1:])
        & (observations.stop[1:] == observations.stop[:-1] + 1)
    )
    moved = observations.node[before + 1] - observations.node[before]
    single = np.sum(np.abs(moved), axis=1) == 1
    found: dict[Place, list[tuple[int, int]]] = {}
    for row, change in zip(before[single], moved[single], strict=True):
        axis = int(np.argmax(np.abs(change)))
        interval = int(min(observations.node[row, axis], observations.node[row + 1, axis]))
        others = tuple(int(observations.node[row, other]) for other in range(3) if other != axis)
        found.setdefault((axis, interval, others), []).append((row, int(change[axis])))
    means = {}
    for place, rows in found.items():
        weights = np.zeros(count)
        for row, sense in rows:
            weights[row + 1] += sense / len(rows)
            weights[row] -= sense / len(rows)
        means[place] = weights
    return means


def _difference(
    moves: Mapping[str, Mapping[Place, Vector]],
    equation: Equation,
    volume: Volume,
) -> Vector:
    """Return R_j(after i) - R_j(before i) for each interval of i as weights, shape (blocks, n)."""
    line = moves[equation.line]
    place_of_later = [axis for axis in range(3) if axis != equation.earlier].index(equation.later)
    rows = []
    for interval in range(volume.blocks):
        pairs = []
        for (axis, own, others), weights in line.items():
            if axis != equation.earlier or others[place_of_later] != interval:
                continue
            after = list(others)
            after[place_of_later] += 1
            if (axis, own, tuple(after)) in line:
                pairs.append(line[axis, own, tuple(after)] - weights)
        if not pairs:
            raise NotDeterminable(
                f"the move of {AXES[equation.earlier]} on {equation.line} was not measured both "
                f"before and after {AXES[equation.later]} moved over its interval {interval + 1}: "
                "measure the diagonal in the three orders XYZ, YZX, ZXY",
                fault="missing",
                aspect="orders",
            )
        rows.append(np.mean(pairs, axis=0))
    return np.stack(rows)


def _result(
    observations: Observations, chain: str, matrix: Vector, shared: bool, lines: int
) -> VolumetricErrors:
    """Make the result of the map from readings to the five angles, shape (5, N + 1, n)."""
    volume = observations.volume
    noise, remarks = noise_of(observations)
    names = angles_seen(chain)
    excess = observations.excess
    values = matrix @ excess
    spread = matrix * noise
    uncertainty = np.linalg.norm(spread, axis=2)
    spread = spread.reshape(-1, len(excess))
    covariance = spread @ spread.T
    not_determined = [
        f"{', '.join(angles_not_seen(chain))}: no step diagonal shows these angles on a machine of "
        f"the chain {chain}; linear lines beside the diagonals show some of them (rigid_body)."
    ]
    figures = []
    for row, name in enumerate(names):
        straight = deviations_from_line(volume.nodes(moving_axis(name)))
        figures.append(_range(f"shape {name}", straight @ matrix[row], excess, noise))
        if shared:
            figures.append(_range(f"angular {name}", matrix[row], excess, noise))
    if not shared:
        not_determined.insert(
            0,
            f"{', '.join(names)}: only the shape is determined, not the slope, since the orders of "
            "a diagonal were aligned one by one. Measure them in one alignment "
            f"('{ONE_ALIGNMENT}' in the plan).",
        )
        values, uncertainty = np.full_like(values, np.nan), np.full_like(uncertainty, np.nan)
        covariance = np.full_like(covariance, np.nan)
    nodes = volume.all_nodes
    return VolumetricErrors(
        method="soons",
        nodes=nodes,
        curves=dict(zip(names, values, strict=True)),
        standard_uncertainty=dict(zip(names, uncertainty, strict=True)),
        figures=tuple(figures),
        lines=lines,
        chi_squared=float("nan"),
        degrees_of_freedom=0,
        not_determined=tuple(not_determined),
        remarks=(*remarks, *_remarks(volume, chain, noise_of(observations, widened=False)[0])),
        covariance=covariance,
        frame=ANGULAR_FRAME,
    )


def _range(name: str, matrix: Vector, excess: Vector, noise: Vector) -> Figure:
    """Return the largest minus the smallest value of a curve that is ``matrix @ excess``."""
    values, spread = matrix @ excess, matrix * noise
    high, low = np.argmax(values), np.argmin(values)
    uncertainty = np.hypot(
        np.linalg.norm(spread[high] - spread[low]), range_excess(values, spread @ spread.T)
    )
    return Figure(name, float(values[high] - values[low]), float(uncertainty), "rad")


def _remarks(volume: Volume, chain: str, noise: Vector) -> list[str]:
    """Say what IH eq. (29) warns of, for these readings."""
    typical = float(np.sqrt(2.0 * np.mean(noise**2)))
    if not np.isfinite(typical):
        return []
    sizes = angle_uncertainty(volume, chain, typical)
    name = max(sizes, key=lambda angle: sizes[angle].worst_over_travel)
    size = sizes[name]
    return [
        f"A single displacement has a standard uncertainty of {typical * 1e6:.2g} µm. Were all off "
        f"by that much in the worst directions (Ibaraki & Hata 2010, eq. 29), {name} would err by "
        f"{size.worst_per_block:.2g} rad in a block and {size.worst_over_travel:.2g} rad over the "
        f"travel; by chance, without repeats, by {size.standard_over_travel:.2g} rad."
    ]


METHOD = Method(
    name="soons",
    title="Soons' angles (Ibaraki & Hata)",
    summary="five of the nine angular errors, from moves in another order",
    needs="step diagonals in three orders of the moves, and the chain of the axes",
    source="IH eqs. 24-28",
    solve=solve_soons,
    order=40,
    reliance=4,
    free_curves=5,
)
