"""The uncertainty budget of a result by the GUM: each source, each quantity, all correlations.

Every source acts on the readings in a known pattern, every reading on the quantities by the
sensitivity of the method: the contribution of a source to the covariance of the result is
``F·Fᵀ`` with F the product of the two. Sources are independent of each other; within a source the
readings that it shares are fully correlated, which is what a budget of single readings would miss.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.limits import BUDGET, require_size_for
from stepdiag_ros.metrology.uncertainty.instrument import Instrument
from stepdiag_ros.metrology.uncertainty.length_sources import readings_of
from stepdiag_ros.metrology.uncertainty.sensitivity import Sensitivity, sensitivity
from stepdiag_ros.metrology.uncertainty.source import GROUPS, Source
from stepdiag_ros.metrology.uncertainty.sources import direct_sources, sources_of

_NOTHING = 1e-9
"""A source whose effect on a quantity is a smaller share of its largest has none."""


@dataclass(frozen=True)
class Budget:
    """A whole budget; q quantities, s sources.

    Attributes:
        method: name of the method.
        instrument: name of the instrument description.
        coverage: probability of the expanded uncertainties.
        sensitivity: of the method.
        sources: all of them, known or not.
        contributions: standard uncertainty of each quantity by each source alone, m and rad, shape
            (s, q); NaN where the source is not known and acts on the quantity; 0 where it does not
            act, known or not.
        covariance: of all quantities by all known sources, shape (q, q).
        degrees_of_freedom: effective, by Welch and Satterthwaite (GUM G.4.1), shape (q,).
        coverage_factor: by Student's t of these, shape (q,).
        remarks: what the reader must know, in words.
    """

    method: str
    instrument: str
    coverage: float
    sensitivity: Sensitivity
    sources: tuple[Source, ...]
    contributions: Vector
    covariance: Vector
    degrees_of_freedom: Vector
    coverage_factor: Vector
    remarks: tuple[str, ...] = ()

    @property
    def standard_uncertainty(self) -> Vector:
        """Return the combined standard uncertainties of all known sources, shape (q,)."""
        combined: Vector = np.sqrt(np.diag(self.covariance))
        return combined

    @property
    def expanded(self) -> Vector:
        """Return the expanded uncertainties U, shape (q,)."""
        return self.coverage_factor * self.standard_uncertainty

    @property
    def at_least(self) -> NDArray[np.bool_]:
        """Say for which quantities a source that acts is not known: U is then a lower bound."""
        return np.asarray(np.any(np.isnan(self.contributions), axis=0))

    @property
    def unknown_sources(self) -> tuple[str, ...]:
        """Return the names of the sources that act and are not known."""
        return tuple(
            source.name
            for source, sizes in zip(self.sources, self.contributions, strict=True)
            if np.any(np.isnan(sizes))
        )

    def groups(self) -> dict[str, Vector]:
        """Return the contributions of groups of sources, shape (q,) each; NaN as above."""
        found: dict[str, Vector] = {}
        for group in GROUPS:
            rows = [row for row, source in enumerate(self.sources) if source.group == group]
            if rows:
                found[group] = np.sqrt(np.sum(self.contributions[rows] ** 2, axis=0))
        return found

    @property
    def largest_group(self) -> str:
        """Return the group of sources that contributes most to the curves of displacements."""
        of_curves = [
            number
            for number, quantity in enumerate(self.sensitivity.quantities)
            if quantity.curve and quantity.unit == "m"
        ]
        sizes = {group: np.nansum(sizes[of_curves] ** 2) for group, sizes in self.groups().items()}
        return max(sizes, key=lambda group: sizes[group])

    def row(self, name: str) -> int:
        """Return the place of a quantity.

        Raises:
            KeyError: the result has no such quantity.
        """
        for number, quantity in enumerate(self.sensitivity.quantities):
            if quantity.name == name:
                return number
        raise KeyError(f"the {self.method} result has no quantity '{name}'")


def make_budget(
    measurement: Measurement,
    instrument: Instrument,
    method: str = "least_squares",
    coverage: float = 0.95,
    expansion: float = float("nan"),
    material_temperature: float | None = None,
) -> Budget:
    """Return the uncertainty budget of everything that a method determines.

    Args:
        measurement: as solved: corrected to 20 degC if an expansion coefficient is given.
        instrument: what is known of how well everything is known.
        method: one of ``monte_carlo.replicable``.
        coverage: probability, for example 0.95.
        expansion: coefficient that the measurement was corrected with, 1/K; NaN if it was not.
        material_temperature: taken instead of the recorded one, degC.

    Raises:
        NotDeterminable: the lines are not enough for this method.
        TooLarge: the run has too many blocks (``solvers.limits``).
        ValueError: the lines contradict the volume or each other, or an argument is out of range.
    """
    require_size_for(BUDGET, measurement.volume.blocks, measurement.stop_count)
    if not 0.5 <= coverage < 1.0:
        raise Refusal(
            f"the coverage probability is {coverage:g}; expected 0.5 to 1, e.g. 0.95",
            fault="out_of_range",
        )
    found = sensitivity(measurement, method)
    readings = readings_of(measurement, found.observations, expansion, material_temperature)
    sources = (
        *sources_of(readings, instrument, found.estimator),
        *direct_sources(readings, found.by_direct),
    )
    names = [quantity.name for quantity in found.quantities]
    count = len(names)
    contributions = np.zeros((len(sources), count))
    covariance = np.zeros((count, count))
    for row, source in enumerate(sources):
        factors = source.errors(found.matrix, names)
        size = np.linalg.norm(factors, axis=1)
        acts = size > _NOTHING * _scale(source, found)
        if source.known:
            contributions[row] = np.where(acts, size, 0.0)
            covariance += factors @ factors.T
        else:
            contributions[row] = np.where(acts, np.nan, 0.0)
    freedom = effective_degrees_of_freedom(
        contributions, np.array([source.degrees_of_freedom for source in sources])
    )
    return Budget(
        method=method,
        instrument=instrument.name,
        coverage=coverage,
        sensitivity=found,
        sources=sources,
        contributions=contributions,
        covariance=covariance,
        degrees_of_freedom=freedom,
        coverage_factor=coverage_factor(freedom, coverage),
        remarks=tuple(_remarks(sources, contributions, expansion)),
    )


def effective_degrees_of_freedom(contributions: Vector, freedom: Vector) -> Vector:
    """Return ν_eff = u⁴ / Σ u_i⁴/ν_i of each quantity (Welch & Satterthwaite, GUM G.2b).

    Args:
        contributions: u_i, shape (s, q); NaN (unknown) counts as nothing.
        freedom: ν_i, shape (s,); infinite ones do not count.
    """
    known = np.nan_to_num(contributions)
    total = np.sum(known**2, axis=0) ** 2
    below = np.sum(known**4 / freedom[:, None], axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        effective: Vector = np.where(below > 0.0, total / below, np.inf)
    return effective


def coverage_factor(freedom: Vector, coverage: float) -> Vector:
    """Return the coverage factors k by Student's t (GUM G.3), shape as given.

    Args:
        freedom: effective degrees of freedom, cut to a whole number as GUM G.4.1 has it; infinite
            for a normal distribution.
        coverage: probability.
    """
    from scipy.special import ndtri, stdtrit

    level = 0.5 + 0.5 * coverage
    whole = np.floor(np.minimum(freedom, 1e12) + 1e-9)
    factor: Vector = np.where(
        np.isfinite(freedom) & (whole < 1e9), stdtrit(np.maximum(whole, 1.0), level), ndtri(level)
    )
    return factor


def _scale(source: Source, found: Sensitivity) -> float:
    """Return how large the effect of a source could be on a quantity as sensitive as the most."""
    unit = source.standard_uncertainty if np.isfinite(source.standard_uncertainty) else 1.0
    largest = float(np.max(np.abs(np.nan_to_num(source.slopes, nan=1.0)))) * unit
    return largest * float(np.max(np.abs(found.matrix)))


def _remarks(sources: tuple[Source, ...], contributions: Vector, expansion: float) -> list[str]:
    remarks = []
    acting = np.any(np.isnan(contributions), axis=1)
    unknown = [source.name for source, acts in zip(sources, acting, strict=True) if acts]
    if unknown:
        remarks.append(
            "Not known, so that the uncertainties marked ≥ are lower bounds: "
            + ", ".join(unknown)
            + "."
        )
    if not np.isfinite(expansion):
        remarks.append(
            "Nothing was corrected to 20 °C: the results hold at the temperature that the machine "
            "had, and the expansion of its material is in no contribution."
        )
    named: dict[str, dict[str, None]] = {}
    for source in sources:
        if source.note:
            named.setdefault(source.note, {})[source.name] = None
    notes = [f"{', '.join(names)}: {note}." for note, names in named.items()]
    return [*remarks, *notes]
