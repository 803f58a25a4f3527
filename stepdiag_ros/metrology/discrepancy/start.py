"""A run and the model that it is compared with, before anything is looked for."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.discrepancy.baseline import Baseline, fit_baseline
from stepdiag_ros.metrology.discrepancy.noise import Noise, estimate_noise
from stepdiag_ros.metrology.discrepancy.steady import steadied
from stepdiag_ros.metrology.effects.effect import ActiveEffect, Effect
from stepdiag_ros.metrology.effects.stops import Stops, stops_of
from stepdiag_ros.metrology.measurement import Measurement

Progress = Callable[[str], None]
"""Called with what is being done."""


@dataclass(frozen=True)
class Start:
    """A run with its fitted baseline and the noise that its repeats show."""

    measurement: Measurement
    stops: Stops
    baseline: Baseline
    noise: Noise

    @property
    def noise_is_known(self) -> bool:
        """Say whether the noise could be estimated."""
        return bool(np.isfinite(self.noise.size) and self.noise.size > 0.0)


@dataclass(frozen=True)
class Model:
    """What a run is compared with: see ``diagnose``."""

    known: tuple[ActiveEffect, ...]
    fitted: tuple[ActiveEffect, ...]
    curves: Mapping[str, Sequence[float]] | None
    effects: list[Effect]

    def start(self, measurement: Measurement) -> Start:
        """Fit the baseline of a run and estimate its noise."""
        stops = steadied(stops_of(measurement))
        baseline = fit_baseline(measurement, stops, self.known, self.fitted, self.curves)
        noise = estimate_noise(baseline, baseline.gap, stops, stated_noise(measurement))
        return Start(measurement, stops, baseline, noise)


def stated_noise(measurement: Measurement) -> float:
    """Return the standard uncertainty that comes beside readings, m; NaN if none does."""
    values = np.concatenate([line.standard_uncertainty for line in measurement.lines])
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
