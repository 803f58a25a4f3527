"""Setup-robust formulation of the step diagonal test (Ibaraki & Hata 2010, section 3.2)."""

import numpy as np

from stepdiag_ros.metrology.geometry import (
    AXES,
    BODY_DIAGONALS,
    FACE_DIAGONALS,
    FIXED_AT_END,
    LINEAR_LINES,
    TRANSLATIONS,
    Vector,
    line_signs,
    translation,
)
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.solvers.linear import (
    DIAGONALS,
    LinearMap,
    accumulate,
    apply,
    remarks_on_unused,
)
from stepdiag_ros.metrology.solvers.method import Method
from stepdiag_ros.metrology.solvers.monte_carlo import linear
from stepdiag_ros.metrology.solvers.observations import (
    ALL_READINGS,
    Observations,
    block_means,
    observe,
)
from stepdiag_ros.metrology.solvers.result import VolumetricErrors

_X, _Y, _Z = range(3)
LAMBDAS = ("xx", "yx", "zx", "xy", "yy", "zy", "xz", "yz", "zz")
"""The nine λ of IH eq. (15) in the order of the result's figures."""


def solve_setup_robust(measurement: Measurement) -> VolumetricErrors:
    """Solve IH eqs. (6)-(19), or of faces their two-dimensional form (``setup_robust_map``).

    The linear lines cancel the errors of the setups.

    Misalignment adds a constant to every block's displacement (eq. 4); the nine combinations λ of
    these constants (eq. 15) follow from the linear lines (16), the frame (17, 18) and the closure
    of a block (5, 19), the latter evaluated in the order xz, xy, zy. Exact to the first order of
    the misalignment. Unequal steps a_x, a_y, a_z are allowed. The result has the figures ``lambda
    xx`` … (m per block).

    Raises:
        NotDeterminable: one of ppp, npp, pnp, x, y, z is missing or has a move that was never
            measured; of faces, one of the two diagonals or linear lines of a face.
        ValueError: the lines contradict the volume.
    """
    observations = observe(measurement)
    lines = _lines(observations)
    return apply(
        "setup_robust",
        measurement,
        observations,
        setup_robust_map,
        lines,
        remarks_on_unused("setup-robust", observations, lines),
    )


def setup_robust_map(observations: Observations, readings: slice = ALL_READINGS) -> LinearMap:
    """Return the formulation as a matrix on the readings.

    Where there are step diagonals of faces and none of the body: the two-dimensional formulation
    (Ibaraki, Hata & Matsubara 2009, reference 9 of IH), to which the equations reduce in each face.

    Raises:
        NotDeterminable: as ``solve_setup_robust``.
    """
    faces = _faces(observations)
    return _of_faces(observations, faces, readings) if faces else body_map(observations, readings)


def body_map(observations: Observations, readings: slice = ALL_READINGS) -> LinearMap:
    """Return the formulation for three body diagonals, IH eqs. (6)-(19).

    Every quantity below is a matrix with one column a reading, and stands for its excess over a
    perfect machine and setup: a_x in (6) and its like are gone with it, and so are the a_x in (16).

    Raises:
        NotDeterminable: as ``solve_setup_robust``.
    """
    step = np.asarray(observations.volume.step)
    # IH write ‖a‖/(2a_x) for the factor from a displacement along the beam to one along the axis.
    gain = np.linalg.norm(step) / (2.0 * step)
    ppp, npp, pnp = block_means(observations, DIAGONALS, readings).weights
    linear = block_means(observations, ("x", "y", "z"), readings).weights
    straight = [linear[axis, axis] for axis in range(3)]

    # The bracket { } of (6)-(14) without λ: error direction, then moving axis.
    bracket: dict[str, Vector] = {
        "xx": ppp[_X] + npp[_X],
        "yx": ppp[_X] - pnp[_X],
        "zx": pnp[_X] - npp[_X],
        "xy": ppp[_Y] - npp[_Y],
        "yy": ppp[_Y] + pnp[_Y],
        "zy": npp[_Y] - pnp[_Y],
        "xz": ppp[_Z] - npp[_Z],
        "yz": ppp[_Z] - pnp[_Z],
        "zz": npp[_Z] + pnp[_Z],
    }

    def mean(values: Vector) -> Vector:
        averaged: Vector = np.mean(values, axis=0)
        return averaged

    lambdas: dict[str, Vector] = {}
    for axis, name in enumerate(("xx", "yy", "zz")):
        lambdas[name] = mean(bracket[name] - straight[axis] / gain[axis])  # (16)
    for name in ("yx", "zx", "yz"):
        lambdas[name] = mean(bracket[name])  # (18) with (17)
    lambdas["xz"] = -lambdas["zx"] - lambdas["xx"] - lambdas["yy"] - lambdas["zz"]  # (19)
    lambdas["xy"] = -lambdas["yx"] - lambdas["zx"] - lambdas["xz"]
    lambdas["zy"] = -lambdas["yx"] - lambdas["yz"] - lambdas["xy"]

    increments = np.empty((3, 3, *straight[0].shape))
    for axis, moving in enumerate("xyz"):
        for error, letter in enumerate("xyz"):
            name = letter + moving
            increments[axis, error] = (
                straight[axis]
                if axis == error
                else gain[error] * (bracket[name] - lambdas[name])  # (7)-(9), (11)-(13)
            )
    return LinearMap(
        accumulate(increments),
        np.array([lambdas[name] for name in LAMBDAS]),
        tuple(f"lambda {name}" for name in LAMBDAS),
    )


def _measured(observations: Observations) -> set[str]:
    """Return the names of the step diagonals: along which single axes moved, and more than one."""
    moved = np.count_nonzero(np.diff(observations.node, axis=0), axis=1)
    single = (moved == 1) & (np.diff(observations.passes) == 0)
    setups = [observations.setups[number] for number in np.unique(observations.setup[1:][single])]
    return {setup.line for setup in setups if setup.diagonal}


def _faces(observations: Observations) -> list[tuple[str, str]]:
    """Return the pairs of step diagonals of the faces of which one was measured, if no other was.

    A face of which one diagonal is missing is among them: a remark names it.
    """
    measured = _measured(observations)
    if measured & set(BODY_DIAGONALS):
        return []
    pairs = zip(FACE_DIAGONALS[::2], FACE_DIAGONALS[1::2], strict=True)
    return [pair for pair in pairs if measured & set(pair)]


def _lines(observations: Observations) -> tuple[str, ...]:
    """Return the names of the lines that the formulation uses."""
    faces = _faces(observations)
    if not faces:
        return (*DIAGONALS, *LINEAR_LINES)
    axes = np.any([line_signs(pair[0]) != 0 for pair in faces], axis=0)
    linear = [name for name, moves in zip(LINEAR_LINES, axes, strict=True) if moves]
    return (*(name for pair in faces for name in pair), *linear)


def _of_faces(
    observations: Observations, faces: list[tuple[str, str]], readings: slice
) -> LinearMap:
    """Return the two-dimensional formulation in each face.

    On the diagonals p and n of the face of the axes i and j, as i moves over an interval, the
    excess is R_i,p = l_i Δe_i + l_j Δe_j + δ_i,p and R_i,n = l_i Δe_i - l_j Δe_j + δ_i,n, and as j
    moves R_j,p = l_j Δe_j + l_i Δe_i + δ_j,p and R_j,n = l_j Δe_j - l_i Δe_i + δ_j,n. So

        Δe_j(i) = (R_i,p - R_i,n - λ_ji) / 2 l_j,    Δe_i(j) = (R_j,p - R_j,n - λ_ij) / 2 l_i,

    and by the closure of a block (IH eq. 5) λ_ij = -λ_ji, which the frame (eq. 17) fixes.
    Positioning errors are those of the linear lines: setup errors spoil nothing else.
    """
    step = np.asarray(observations.volume.step)
    blocks, every = observations.volume.blocks, len(observations.displacement)
    increments = np.full((3, 3, blocks, len(range(*readings.indices(every)))), np.nan)
    parameters, names = [], []
    for pair in faces:
        first, second = (int(axis) for axis in np.flatnonzero(line_signs(pair[0])))
        lines = (*pair, LINEAR_LINES[first], LINEAR_LINES[second])
        means = block_means(observations, lines, readings).weights
        gain = np.linalg.norm(step[[first, second]]) / (2.0 * step)
        bracket = {moving: means[0, moving] - means[1, moving] for moving in (first, second)}
        # IH eq. (17): of the two curves across, E_YX, E_ZX or E_YZ ends at zero.
        fixed = second if translation(first, second) in FIXED_AT_END else first
        parameter = np.mean(bracket[fixed], axis=0)
        for place, (moving, other) in enumerate(((first, second), (second, first))):
            sign = 1.0 if moving == fixed else -1.0
            increments[moving, other] = gain[other] * (bracket[moving] - sign * parameter)
            increments[moving, moving] = means[2 + place, moving]
        parameters.append(parameter)
        names.append(f"lambda {AXES[first + second - fixed]}{AXES[fixed]}".lower())
    return LinearMap(accumulate(increments), np.array(parameters), tuple(names))


METHOD = Method(
    name="setup_robust",
    title="Setup-robust (Ibaraki & Hata)",
    summary="nine curves; linear lines cancel the errors of the setups",
    needs="three step diagonals and three linear lines, or those of faces",
    source="IH eqs. 6-19",
    solve=solve_setup_robust,
    order=20,
    reliance=2,
    curves=TRANSLATIONS,
    free_curves=len(TRANSLATIONS),
    estimator=linear(setup_robust_map),
)
