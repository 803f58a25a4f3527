"""Interferometer nonlinearity: the reading swings with the phase of the light.

The reading itself determines the phase, in wavelengths: the commanded position is not known to a
fraction of one. It can be seen only in noise well below a fringe over 2π (50 nm for half a
wavelength), and, as every setup has a zero of its own, has a phase of its own there.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.air import HELIUM_NEON_WAVELENGTH, refractive_index
from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.passes import setup_index
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import Vector


class InterferometerNonlinearity(Effect):
    """Error of the reading with a period of a part of the wavelength, in one setup."""

    name = "interferometer nonlinearity"
    sentence = (
        "Light leaks between the polarizations, so that the count is not even within a fringe."
    )
    source = "Quenelle 1983; Bobroff 1993, Meas. Sci. Technol. 4, 907 (first and second harmonic)"
    keys = (Key("setup", str), Key("period_m", float))
    sizes = (
        Size("sine", "m", -20e-9, 20e-9, "amplitude of the sine from the zero of the setup"),
        Size("cosine", "m", -20e-9, 20e-9, "amplitude of the cosine from the zero of the setup"),
    )
    needs = ("displacement",)

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield each setup with half, a quarter and an eighth of the wavelength in vacuum."""
        if self.known(stops):
            for setup in stops.setups:
                for part in (2, 4, 8):
                    yield {"setup": setup, "period_m": HELIUM_NEON_WAVELENGTH / part}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return sine·sin + cosine·(cos - 1) of 2π·n·reading/period on the setup."""
        here = stops.setup == setup_index(setting, stops)
        phase = 2.0 * np.pi * _index(stops) * stops.displacement / setting["period_m"]
        swing = sizes["sine"] * np.sin(phase) + sizes["cosine"] * (np.cos(phase) - 1.0)
        return Change(reading=np.where(here, swing, 0.0))

    def label(self, setting: Setting) -> str:
        """Say for example ``interferometer nonlinearity of ppp XYZ, period 316.5 nm``."""
        return f"{self.name} of {setting['setup']}, period {setting['period_m'] * 1e9:.4g} nm"


def _index(stops: Stops) -> Vector:
    """Return the refractive index by which readings were made from wavelengths in vacuum."""
    index: Vector = refractive_index(
        np.where(np.isfinite(stops.air_temperature), stops.air_temperature, 20.0),
        np.where(np.isfinite(stops.air_pressure), stops.air_pressure, 101325.0),
        np.where(np.isfinite(stops.relative_humidity), stops.relative_humidity, 0.5),
    )
    return index


EFFECT = InterferometerNonlinearity()
