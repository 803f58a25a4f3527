"""The sources of uncertainty of a measurement, each with what it does to every reading.

What acts on a displacement as a length (laser, air, dead path, material) is in ``length_sources``;
here are setup, scatter, drift, lack of fit and the angular errors that a model leaves out.
"""

from dataclasses import replace

import numpy as np

from stepdiag_ros.metrology.forward import perpendiculars
from stepdiag_ros.metrology.geometry import AXES, BODY_DIAGONALS, ROTATIONS, Vector, line_signs
from stepdiag_ros.metrology.plausible import mode_count, modes
from stepdiag_ros.metrology.solvers.monte_carlo import Estimator, LeastSquaresEstimator
from stepdiag_ros.metrology.solvers.noise_factor import exceeds_chance
from stepdiag_ros.metrology.solvers.rotations import SHOWN, mode_readings, turned
from stepdiag_ros.metrology.standards.length_effects import rotation_effects
from stepdiag_ros.metrology.uncertainty.instrument import NORMAL, Instrument, Spread
from stepdiag_ros.metrology.uncertainty.length_sources import (
    Readings,
    air_sources,
    instrument_sources,
    material_sources,
)
from stepdiag_ros.metrology.uncertainty.repeats import repeats_of
from stepdiag_ros.metrology.uncertainty.source import (
    ANGULAR,
    COMMON,
    DIRECT,
    DRIFT,
    MODEL,
    PER_PASS,
    PER_PLACE,
    PER_POSITION,
    PER_READING,
    REPEATABILITY,
    SETUP,
    SQUARED_ANGLE,
    DirectSource,
    Source,
    each_setup,
)

_UNKNOWN = float("nan")
_INFINITE = float("inf")


def sources_of(readings: Readings, instrument: Instrument, method: Estimator) -> list[Source]:
    """Return all sources of uncertainty of a result.

    Args:
        readings: with their air and material.
        instrument: what is known of how well everything is known.
        method: that the result comes from; what its model holds is not a source.
    """
    scatter = _scatter(readings)
    angular = [] if set(ROTATIONS) <= set(method.names) else _angular(readings, instrument, method)
    return [
        *instrument_sources(readings, instrument),
        *air_sources(readings, instrument),
        *material_sources(readings, instrument),
        *_setup(readings, instrument, method.models_cosine),
        *scatter,
        *_misfit(method, scatter[0].standard_uncertainty, readings.observations.rounding),
        *angular,
    ]


def _setup(readings: Readings, instrument: Instrument, models_cosine: bool) -> list[Source]:
    """Return what beam and mirror do: turned together, and each against the other.

    With the mirror's normal turned by t and the beam by r against it, a reading is along
    m/(l·m) = m·(1 + r²/2): to the first order t·q, which diagonals show and linear lines do not; to
    the second the cosine errors -t²/2 and +r²/2 of the whole displacement (``forward``, with
    δl = t - r, δm = t).
    """
    seen = readings.observations
    nominal = seen.displacement
    diagonal = np.array([setup.diagonal for setup in seen.setups])[seen.setup]
    pairs = np.array([perpendiculars(setup.direction) for setup in seen.setups])[seen.setup]
    sideways = np.einsum("ncx,nx->cn", pairs, seen.way)
    fitted = "the fit takes its first order" if models_cosine else ""
    cosine = np.where(diagonal, 0.0, -nominal) if models_cosine else -nominal
    made = [
        each_setup(
            "cosine of beam and mirror on the line",
            SETUP,
            _squared(instrument.alignment),
            "relative",
            [cosine],
            seen.setup,
            fitted,
        ),
        each_setup(
            "cosine of beam against mirror",
            SETUP,
            _squared(instrument.return_angle),
            "relative",
            [nominal],
            seen.setup,
        ),
    ]
    if not models_cosine:
        made.insert(
            0,
            each_setup(
                "beam and mirror off the line",
                SETUP,
                instrument.alignment,
                "rad",
                list(np.where(diagonal, sideways, 0.0)),
                seen.setup,
            ),
        )
    return made


def _scatter(readings: Readings) -> list[Source]:
    """Return repeatability and drift, from repeats or from the readings' own uncertainties."""
    seen = readings.observations
    found = repeats_of(readings.measurement, seen)
    each = np.ones_like(seen.displacement)
    if found.reading_freedom:
        repeatability = Source(
            "repeatability of a reading",
            REPEATABILITY,
            found.reading,
            "m",
            "A",
            NORMAL,
            found.reading_freedom,
            PER_READING,
            each[None, :],
            np.arange(len(each)),
            "from repeated passes",
        )
    else:
        own = seen.uncertainty if seen.noise_known else np.full(len(each), _UNKNOWN)
        typical = float(np.sqrt(np.mean(own**2)))
        repeatability = Source(
            "repeatability of a reading",
            REPEATABILITY,
            typical,
            "m",
            "A",
            NORMAL,
            _INFINITE,
            PER_READING,
            (own / typical)[None, :] if typical > 0.0 else each[None, :],
            np.arange(len(each)),
            "from the readings at each stop alone: no pass was repeated"
            if seen.noise_known
            else "no pass was repeated, and the readings have no uncertainty",
        )
    _, passes = np.unique(seen.passes, return_inverse=True)
    note = "" if found.pass_freedom else "no pass was repeated"
    freedom = float(found.pass_freedom) if found.pass_freedom else _INFINITE

    def drift(name: str, size: float, unit: str, slope: Vector) -> Source:
        return Source(
            name,
            DRIFT,
            size,
            unit,
            "A",
            NORMAL,
            freedom,
            PER_PASS,
            slope[None, :],
            passes.reshape(-1).astype(np.int64),
            note,
        )

    return [
        repeatability,
        drift("drift of the zero", found.offset, "m", each),
        drift("drift along the line", found.slope, "m/m", seen.displacement - found.centre),
    ]


def _misfit(method: Estimator, noise: float, rounding: float) -> list[Source]:
    """Return what the residuals of a fit hold beyond the readings' scatter; none if chance does it.

    Repeats share it, so that it is one unknown value for each place of each setup. With σ the
    scatter and n_k readings at the place k, the variance of what a fit leaves is that of
    the lack of fit plus the mean of σ²/n_k and the variance of the rounding that they share. The
    threshold is that of ``solve_least_squares``: p < 0.01.
    """
    if not isinstance(method, LeastSquaresEstimator):
        return []
    left, group, freedom = method.misfit()
    if freedom < 1 or not max(noise, rounding) > 0.0:
        return []
    expected = noise**2 / np.bincount(group) + rounding**2
    if not exceeds_chance(float(np.sum(left**2 / expected)), freedom):
        return []
    variance = float(np.sum(left**2)) / freedom - float(np.mean(expected))
    return [
        Source(
            MODEL,
            MODEL,
            float(np.sqrt(max(variance, 0.0))),
            "m",
            "A",
            NORMAL,
            float(freedom),
            PER_PLACE,
            np.ones((1, len(group))),
            group,
            "the residuals are larger than repeats explain; something is not in the model",
        )
    ]


def _size_of_rotations(
    readings: Readings, instrument: Instrument, method: Estimator
) -> tuple[Spread, str]:
    """Return how large angular errors are, and who says so: the largest that anybody does."""
    measurement = readings.measurement
    spread, note = instrument.angular_errors, ""
    if not spread.known:
        spread = Spread(measurement.plausible.rotation)
        size = f"{spread.standard_uncertainty * 1e6:.3g} µrad"
        note = f"not in the instrument file: {size}, the plausible size of the machine"
    own = method.rotations if isinstance(method, LeastSquaresEstimator) else None
    if own is None:
        own = turned(measurement, replace(readings.observations, direct=None)).rotations
    if own.chance < SHOWN and own.size > spread.standard_uncertainty:
        before = f"{spread.standard_uncertainty * 1e6:.3g} µrad"
        note = f"{own.size * 1e6:.3g} µrad, as the readings show, and not {before} as stated"
        spread = Spread(own.size)
    return spread, note


def _angular(readings: Readings, instrument: Instrument, method: Estimator) -> list[Source]:
    """Return the angular errors that the model of the method leaves out.

    Each of the nine is a random curve from zero at the first corner of the box, of the stated size
    at its last node, with waves on the way (``plausible``): a tilt that grows does not average out
    over a line, and waves make straightness. Where the instrument description states no size, it is
    the plausible one of the measurement; where the readings show a larger one, it is that.
    """
    seen, measurement = readings.observations, readings.measurement
    spread, note = _size_of_rotations(readings, instrument, method)
    count = mode_count(seen.volume.blocks)
    slopes = np.full((3, 3 * count, len(seen.displacement)), _UNKNOWN)
    truly: dict[str, Vector] = {}
    if measurement.chain:
        travel = np.asarray(seen.volume.step) * seen.volume.blocks
        by_mode = mode_readings(seen, measurement.chain).T
        in_model = [name in method.names for name in ROTATIONS]
        by_mode.reshape(len(ROTATIONS), count, -1)[in_model] = 0.0
        slopes = by_mode.reshape(slopes.shape)
        truly = _of_diagonals(travel, measurement.chain, count)
        for effect in truly.values():
            effect.reshape(len(ROTATIONS), count)[in_model] = 0.0
    else:
        note = "the order of the machine's axes is not known"
    return [
        Source(
            f"angular errors of {letter}",
            ANGULAR,
            spread.standard_uncertainty,
            "rad",
            "B",
            spread.distribution,
            spread.degrees_of_freedom,
            COMMON,
            slopes[axis],
            np.zeros(len(seen.displacement), dtype=np.int64),
            note,
            {name: effects[axis] for name, effects in truly.items()},
        )
        for axis, letter in enumerate(AXES)
    ]


def _of_diagonals(travel: Vector, chain: str, count: int) -> dict[str, Vector]:
    """Return what each mode of each rotation does to the lengths of body diagonals, m/rad.

    Returns:
        name of the figure → rotations and their modes for X, Y, Z, shape (3, 3 · count).
    """
    signs = np.array([line_signs(line) for line in BODY_DIAGONALS])
    ends = [(travel * (sense < 0), travel * (sense > 0)) for sense in signs]
    at_the_end = modes(np.ones(1), count)[0]
    lengths = rotation_effects(ends, chain)[:, :, None] * at_the_end
    return {
        f"diagonal {line}": lengths[row].reshape(3, 3 * count)
        for row, line in enumerate(BODY_DIAGONALS)
    }


def direct_sources(readings: Readings, by_direct: Vector) -> list[Source]:
    """Return what was measured directly as a source; none where nothing was, or nothing uses it.

    Args:
        readings: beside which it was measured.
        by_direct: see ``Sensitivity``.
    """
    count = len(readings.observations.displacement)
    if not by_direct.size:
        return []
    return [
        DirectSource(
            "errors measured directly",
            DIRECT,
            1.0,
            "1",
            "B",
            NORMAL,
            _INFINITE,
            PER_POSITION,
            np.zeros((1, count)),
            np.zeros(count, dtype=np.int64),
            "in units of the standard uncertainty that is stated for each value",
            by_direct=by_direct,
        )
    ]


def _squared(spread: Spread) -> Spread:
    """Return the spread of half the square of an angle with two such components.

    Its mean is σ² and its standard deviation σ²; what the linear budget takes is the root of its
    mean square about zero, √2·σ², because nothing is corrected for it (GUM F.2.4.5).
    """
    size = np.sqrt(2.0) * spread.standard_uncertainty**2
    # u(x²)/x² is twice u(x)/x, so a quarter of the degrees of freedom (GUM G.4.2, note).
    return Spread(float(size), SQUARED_ANGLE, max(spread.degrees_of_freedom / 4.0, 1.0))
