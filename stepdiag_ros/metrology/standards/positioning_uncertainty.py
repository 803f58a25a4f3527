"""Measurement uncertainty of the parameters of ISO 230-2: contributions and how they add up.

The contributions are those of ISO 230-2 annex A and ISO/TR 230-9 (annex on ISO 230-2): measuring
device, its misalignment, the machine's temperature, the coefficient of thermal expansion, and the
environmental variation error EVE. A contribution that is known by its range r has the standard
uncertainty r/(2·√3); expanded by k = 2 that is the 0.6 r (0.577 r) of the standard:

    U_DEVICE       = U(k = 2) of the calibration per length · L
    U_MISALIGNMENT = R²/(2 L) / √3          (0.3 R²/L: cosine error, R parallel deviation over L)
    U_TEMPERATURE  = α · L · R(θ) / √3      (0.6 α L R(θ))
    U_EXPANSION    = |θ - 20 °C| · L · R(α) / √3
    U_EVE          = E_VE / √3              (0.6 E_VE), independent from one run to the next

The first four scale the length and act on every deviation alike; with U_L their root sum of
squares over the measured length, and with n runs in each direction, the definitions of the
parameters give (derived here, since the annex's text is not among the project's sources)

    U(B)           = √(2/n) · U_EVE               difference of two means; no length between them
    U(E), U(E↑↓)   = √(U_L² + (2/n) · U_EVE²)     difference of two unidirectional means
    U(M)           = √(U_L² + (1/n) · U_EVE²)     difference of two bidirectional means
    U(mean B)      = √(2/n) · U_EVE               mean over targets
    U(R↑↓), U(R)   = 2 · U_EVE                    4 s with s no more than u_EVE of the environment
    U(A), U(A↑↓)   = √(U_L² + (2/n + 4) · U_EVE²) E and R together

Drift of the zero from run to run shifts all targets of a run alike, so that more targets do not
make U(mean B) smaller. What the machine itself does from one run to the next is part of what is
measured (R), not of U.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import nan, sqrt
from typing import Any

from stepdiag_ros.metrology.checking import Section

COVERAGE_FACTOR = 2.0
"""ISO 230-2 and ISO/TR 230-9 state U for k = 2."""


@dataclass(frozen=True)
class UncertaintyDescription:
    """What is known of the measuring conditions; NaN where it is not known.

    Attributes:
        device: expanded uncertainty (k = 2) of the calibrated instrument per length, m/m.
        misalignment: range of the parallel deviation of beam and axis over the length, m.
        temperature_range: range R(θ) of the error of the machine's measured temperature, K.
        expansion_coefficient: of the machine's scale or the workpiece, 1/K.
        expansion_range: range R(α) of the error of that coefficient, 1/K.
        temperature_difference: of the machine from 20 °C during the test, K.
        environmental_variation: E_VE, the range of readings of a machine that stands still for the
            duration of the test, m.
    """

    device: float = nan
    misalignment: float = nan
    temperature_range: float = nan
    expansion_coefficient: float = nan
    expansion_range: float = nan
    temperature_difference: float = nan
    environmental_variation: float = nan

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], source: str) -> "UncertaintyDescription":
        """Make a description from parsed YAML; a key that is missing is unknown.

        Raises:
            ValueError: names the source, the key, what is wrong and what is expected.
        """
        section = Section(mapping, source)
        limits = {
            "device": ("device_U_m_per_m", 0.0, 1e-3),
            "misalignment": ("misalignment_m", 0.0, 1.0),
            "temperature_range": ("temperature_range_K", 0.0, 50.0),
            "expansion_coefficient": ("expansion_coefficient_per_K", -1e-4, 1e-4),
            "expansion_range": ("expansion_range_per_K", 0.0, 1e-4),
            "temperature_difference": ("temperature_difference_K", -80.0, 80.0),
            "environmental_variation": ("environmental_variation_m", 0.0, 1.0),
        }
        values = {
            name: section.number(key, low, high) if key in section.keys() else nan  # noqa: SIM118
            for name, (key, low, high) in limits.items()
        }
        section.finish()
        return cls(**values)

    @property
    def stated(self) -> bool:
        """Say whether anything is known of the conditions."""
        return len(self.unknown()) < len(fields(self))

    def unknown(self) -> tuple[str, ...]:
        """Return what is not known, in words."""
        return tuple(
            field.name.replace("_", " ")
            for field in fields(self)
            if getattr(self, field.name) != getattr(self, field.name)
        )


@dataclass(frozen=True)
class Contributions:
    """Expanded uncertainties (k = 2) over one length, m; NaN where not known."""

    device: float
    misalignment: float
    temperature: float
    expansion: float
    environment: float

    @property
    def length(self) -> float:
        """Return U_L: what acts through the measured length, m."""
        parts = (self.device, self.misalignment, self.temperature, self.expansion)
        return sqrt(sum(part * part for part in parts))


def contributions(description: UncertaintyDescription, length: float) -> Contributions:
    """Return the contributions over a measured length; see the module.

    Args:
        description: of the measuring conditions.
        length: between the first and the last target, m.

    Raises:
        ValueError: the length is not positive.
    """
    if not length > 0:
        raise ValueError(f"the measured length is {length:g} m; expected more than 0")
    half = 1.0 / sqrt(3.0)
    return Contributions(
        device=description.device * length,
        misalignment=half * description.misalignment**2 / (2.0 * length),
        temperature=half
        * abs(description.expansion_coefficient)
        * length
        * description.temperature_range,
        expansion=half
        * abs(description.temperature_difference)
        * length
        * description.expansion_range,
        environment=half * description.environmental_variation,
    )


def expanded_uncertainties(
    description: UncertaintyDescription, length: float, runs: int
) -> dict[str, float]:
    """Return U (k = 2) of the parameters of ISO 230-2, m; NaN where an input is not known.

    Args:
        description: of the measuring conditions.
        length: between the first and the last target, m.
        runs: n in each direction.

    Returns:
        U by the name of the parameter: B, mean B, E, E↑, E↓, M, R, R↑, R↓, A, A↑, A↓.

    Raises:
        ValueError: the length is not positive, or there is no run.
    """
    if runs < 1:
        raise ValueError(f"{runs} runs: expected at least one")
    known = contributions(description, length)
    through_length, eve = known.length, known.environment
    systematic = sqrt(through_length**2 + 2.0 / runs * eve**2)
    accuracy = sqrt(through_length**2 + (2.0 / runs + 4.0) * eve**2)
    made = {
        "B": sqrt(2.0 / runs) * eve,
        "mean B": sqrt(2.0 / runs) * eve,
        "M": sqrt(through_length**2 + eve**2 / runs),
    }
    for arrow in ("", "↑", "↓"):
        made[f"E{arrow}"] = systematic
        made[f"R{arrow}"] = 2.0 * eve
        made[f"A{arrow}"] = accuracy
    return made
