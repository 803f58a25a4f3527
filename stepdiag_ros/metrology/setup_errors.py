"""Setup errors of step diagonals: what they are, the angles they mean, and what they do.

A setup error adds a constant δR to every displacement of one axis on one diagonal (Ibaraki & Hata
2010, eq. 4). To first order it comes from one effective direction: a reading's sensitive direction
is n + d with the nominal beam n and a small d ⊥ n, so that

    δR_i = s_i a_i d_i          s_i: sense in which axis i runs, a_i: its step,

and the sum over a block's three moves is ‖a‖ n·d = 0 (eq. 5). To this order d is the tilt of the
mirror's normal alone. The beam's own tilt δl enters with the second order only, as a scale of the
whole line, |δl|²/2 - δl·δm (``cosine_error``), which these figures do not contain: beam
and mirror cannot be distinguished here. A mirror is set to return the beam, so its tilt is the
beam's as well, but for how well that was done.

Directions are those in the frame of the results (eq. 17): turning the frame turns machine and
setups together, and no reading shows the difference.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.forward import perpendiculars
from stepdiag_ros.metrology.geometry import AXES, Vector, beam_direction, line_signs
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.lengths import length_readings
from stepdiag_ros.metrology.solvers.linear import DIAGONALS, in_parts, noise_of
from stepdiag_ros.metrology.solvers.observations import Observations, observe
from stepdiag_ros.metrology.solvers.rotations import mode_readings
from stepdiag_ros.metrology.solvers.setup_robust import LAMBDAS, body_map

LAMBDA_TERMS: dict[str, tuple[tuple[int, str], tuple[int, str]]] = {
    "xx": ((+1, "ppp"), (+1, "npp")),
    "yx": ((+1, "ppp"), (-1, "pnp")),
    "zx": ((+1, "pnp"), (-1, "npp")),
    "xy": ((+1, "ppp"), (-1, "npp")),
    "yy": ((+1, "ppp"), (+1, "pnp")),
    "zy": ((+1, "npp"), (-1, "pnp")),
    "xz": ((+1, "ppp"), (-1, "npp")),
    "yz": ((+1, "ppp"), (-1, "pnp")),
    "zz": ((+1, "npp"), (+1, "pnp")),
}
"""λ → the two δR of its axis (its second letter) and their signs (Ibaraki & Hata 2010, eq. 15)."""


@dataclass(frozen=True)
class SetupError:
    """The setup error of one diagonal.

    Attributes:
        line: name of the diagonal.
        displacement: δR of the moves of X, Y, Z, m per block, shape (3,).
        displacement_uncertainty: standard uncertainties, m, shape (3,).
        tilt: d, deviation of the effective direction from the nominal beam, rad, shape (3,).
        angles: components along the two ``forward.perpendiculars`` of the beam, rad, shape (2,).
        angle_uncertainty: standard uncertainties, rad, shape (2,).
        setups: how many alignments of this diagonal the figures are the mean of.
    """

    line: str
    displacement: Vector
    displacement_uncertainty: Vector
    tilt: Vector
    angles: Vector
    angle_uncertainty: Vector
    setups: int


def setup_errors(measurement: Measurement) -> tuple[SetupError, ...]:
    """Return the setup errors of ppp, npp and pnp, from the λ of the setup-robust formulation.

    The nine λ of IH eq. (15) are nine combinations of the nine δR, three for each axis, which are
    solved for here; the uncertainties follow from the readings with all their correlations, and
    from what rotations of the axes and the laser's scale do that are plausible: IH take them as
    zero. Angles are the least-squares ones of the three δR of a diagonal, whose sum is zero by eq.
    (5) already.

    Raises:
        NotDeterminable: one of ppp, npp, pnp, x, y, z is missing or has a move that was never
            measured.
        ValueError: the lines contradict the volume.
    """
    observations = observe(measurement)
    step = np.asarray(observations.volume.step)
    noise, _ = noise_of(observations)
    untold = _not_told(observations, measurement)
    excess = observations.excess
    lambdas = np.concatenate(
        [body_map(observations, here).parameters for here in in_parts(len(excess))], axis=1
    )
    inverse = np.linalg.inv(lambda_matrix())
    readings = (inverse @ lambdas).reshape(len(DIAGONALS), 3, -1)

    def spread(rows: Vector) -> Vector:
        variance = np.sum((rows * noise) ** 2, axis=1) + np.sum((rows @ untold) ** 2, axis=1)
        return np.asarray(np.sqrt(variance), dtype=np.float64)

    found = []
    for row, line in enumerate(DIAGONALS):
        pair = np.array(perpendiculars(beam_direction(line, step)))
        arms = pair * line_signs(line) * step
        angles = np.linalg.solve(arms @ arms.T, arms) @ readings[row]
        values = angles @ excess
        found.append(
            SetupError(
                line=line,
                displacement=readings[row] @ excess,
                displacement_uncertainty=spread(readings[row]),
                tilt=values @ pair,
                angles=values,
                angle_uncertainty=spread(angles),
                setups=sum(setup.line == line for setup in observations.setups),
            )
        )
    return tuple(found)


def _not_told(observations: Observations, measurement: Measurement) -> Vector:
    """Return what acts on the readings as much as is plausible, m, shape (n, k).

    Rotations (of each of the six chains, with a sixth of the variance, where the machine's is not
    known) and the laser's scale, each column for one standard uncertainty.
    """
    plausible = measurement.plausible
    turned = plausible.rotation * mode_readings(observations, measurement.chain)
    made: Vector = np.column_stack([turned, length_readings(observations, plausible)])
    return made


def lambda_matrix() -> Vector:
    """Return the matrix from the nine δR to the nine λ (IH eq. 15), shape (9, 9).

    Rows in the order of ``setup_robust.LAMBDAS``; columns ppp x, y, z, npp x, y, z, pnp x, y, z.
    """
    matrix = np.zeros((9, 9))
    for row, name in enumerate(LAMBDAS):
        axis = AXES.index(name[1].upper())
        for sign, line in LAMBDA_TERMS[name]:
            matrix[row, 3 * DIAGONALS.index(line) + axis] = sign
    return matrix


def displacement_of_tilt(line: str, step: Vector, tilt: Vector) -> Vector:
    """Return δR of the moves of X, Y, Z that a tilt d of a diagonal makes, m per block, shape (3,).

    Args:
        line: name of the diagonal.
        step: size of one block along X, Y, Z in m, shape (3,).
        tilt: d, perpendicular to the beam, rad, shape (3,).
    """
    moved: Vector = np.asarray(step) * np.asarray(tilt) * line_signs(line)
    return moved


def conventional_errors(volume: Volume, tilts: Mapping[str, Vector]) -> dict[str, float]:
    """Return by how much setups make the conventional result wrong at each curve's last node, m.

    IH eqs. (6)-(14): ‖a‖/(2a_j)·λ_ji for each block, N times over the travel. The curves between
    are straight lines from zero.

    Args:
        volume: the measured box.
        tilts: ppp, npp, pnp → tilt d of the effective direction, rad, shape (3,); missing is zero.

    Returns:
        ISO 230-1 name → error of the estimate, m, in the order of ``geometry.TRANSLATIONS``.
    """
    step = np.asarray(volume.step)
    none = np.zeros(3)
    constants = {
        line: displacement_of_tilt(line, step, tilts.get(line, none)) for line in DIAGONALS
    }
    gain = gains(volume)
    errors = {}
    for axis, moving in enumerate("xyz"):
        for error, letter in enumerate("xyz"):
            lam = sum(sign * constants[line][axis] for sign, line in LAMBDA_TERMS[letter + moving])
            errors[f"E_{AXES[error]}{AXES[axis]}"] = float(volume.blocks * gain[error] * lam)
    return errors


def gains(volume: Volume) -> Vector:
    """Return ‖a‖/(2a_x), ‖a‖/(2a_y), ‖a‖/(2a_z): the factors of IH eqs. (6)-(14)."""
    step = np.asarray(volume.step)
    factors: Vector = np.linalg.norm(step) / (2.0 * step)
    return factors


@dataclass(frozen=True)
class SetupSensitivity:
    """How much one curve of the conventional result errs with the setups.

    Attributes:
        curve: ISO 230-1 name.
        gain: ‖a‖/(2a_j).
        by_line: the two diagonals in its equation → error at the last node for a tilt in the worst
            direction, m/rad.
        worst: both tilted by as much in their worst directions, m/rad.
    """

    curve: str
    gain: float
    by_line: Mapping[str, float]
    worst: float


def conventional_sensitivity(volume: Volume) -> tuple[SetupSensitivity, ...]:
    """Return the sensitivity of each curve's last node to the setups (IH section 3.1).

    A tilt of size φ of a diagonal changes the displacement of axis i by at most a_i √(1 - n_i²) φ,
    with n its nominal beam: no d ⊥ n points further along axis i. Every curve has two diagonals in
    its equation.
    """
    step = np.asarray(volume.step)
    factors = gains(volume)
    rows = []
    for axis, moving in enumerate("xyz"):
        for error, letter in enumerate("xyz"):
            by_line = {}
            for _, line in LAMBDA_TERMS[letter + moving]:
                cosine = beam_direction(line, step)[axis]
                most = step[axis] * np.sqrt(1.0 - cosine**2)
                by_line[line] = float(volume.blocks * factors[error] * most)
            rows.append(
                SetupSensitivity(
                    f"E_{AXES[error]}{AXES[axis]}",
                    float(factors[error]),
                    by_line,
                    sum(by_line.values()),
                )
            )
    return tuple(rows)


def tilts_for_conventional_errors(
    volume: Volume, errors: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Return the smallest tilts that would make the conventional result wrong by given amounts.

    Least squares where the setups cannot make all of them: E_XX, E_YY and E_ZZ may be chosen; what
    happens to squareness then follows from eq. (5), see ``closure_of_conventional``.

    Args:
        volume: the measured box.
        errors: ISO 230-1 name → error at the last node, m.

    Returns:
        ppp, npp, pnp → two angles along ``forward.perpendiculars``, rad.

    Raises:
        ValueError: a name is not one of the nine curves.
    """
    step = np.asarray(volume.step)
    columns = []
    for line in DIAGONALS:
        for direction in perpendiculars(beam_direction(line, step)):
            made = conventional_errors(volume, {line: direction})
            unknown = [name for name in errors if name not in made]
            if unknown:
                raise Refusal(f"'{unknown[0]}' is not a translational error curve", fault="unknown")
            columns.append([made[name] for name in errors])
    wanted = np.array(list(errors.values()))
    angles = np.linalg.lstsq(np.array(columns).T, wanted, rcond=None)[0].reshape(3, 2)
    return {
        line: (float(one), float(two)) for line, (one, two) in zip(DIAGONALS, angles, strict=True)
    }


def closure_of_conventional(volume: Volume, errors: Mapping[str, float]) -> tuple[float, ...]:
    """Return four sums that are equal where setups alone make the conventional result wrong, m.

    From IH eq. (19). For a cube they are sums of the errors ê at the last nodes: all positioning
    errors together, and the pairs of slopes that make the squarenesses,

        ê_xx + ê_yy + ê_zz = -(ê_zx + ê_xz) = ê_yx + ê_xy = -(ê_yz + ê_zy);

    for unequal steps every ê_j counts √3 a_j/‖a‖ times. In IH Table 1 (conventional minus measured)
    the four are 4.4, 5.5, 4.4 and 6.6 µm: setup errors explain it to about 2 µm.

    Args:
        volume: the measured box.
        errors: ISO 230-1 name → error of the conventional result at the last node, m, all nine.
    """
    step = np.asarray(volume.step)
    cosine = step / np.linalg.norm(step)
    scaled = {name: float(cosine[AXES.index(name[2])]) * errors[name] for name in errors}
    factor = float(np.sqrt(3.0))
    return (
        factor * (scaled["E_XX"] + scaled["E_YY"] + scaled["E_ZZ"]),
        -factor * (scaled["E_ZX"] + scaled["E_XZ"]),
        factor * (scaled["E_YX"] + scaled["E_XY"]),
        -factor * (scaled["E_YZ"] + scaled["E_ZY"]),
    )


def cosine_error(beam_tilt: Vector, mirror_tilt: Vector) -> float:
    """Return the scale that tilts add to a line's readings in the second order.

    |δl|²/2 - δl·δm, with the tilts of beam and mirror normal from the nominal direction; -|δl|²/2
    where the mirror returns the beam. At 0.3 mrad it is -4.5e-8, 9 nm over a diagonal of 208 mm.

    Args:
        beam_tilt: δl, rad, shape (3,).
        mirror_tilt: δm, rad, shape (3,).
    """
    beam, mirror = np.asarray(beam_tilt), np.asarray(mirror_tilt)
    return float(0.5 * beam @ beam - beam @ mirror)
