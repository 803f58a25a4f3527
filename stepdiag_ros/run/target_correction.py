"""Correction of commanded targets by an error map, as the bridge applies it.

A wanted place w becomes the target w - e (``metrology.target_correction``). Positions that
the controller reports stay its own: the machine stands at the corrected target, and ``nominal``
says which place this is meant for.
"""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.devices.cnc import Point
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.target_correction import place_of, target_for
from stepdiag_ros.metrology.volumetric_map import VolumetricMap


@dataclass(frozen=True)
class TargetCorrection:
    """An error map at work.

    Attributes:
        error_map: of the machine, with all compensation at work that was at work in the run that it
            was made from.
        limit: largest correction of an axis, m.
        name: of the map's file.
        sha256: of the map's file, 64 hexadecimal digits.
        made_from: the run that the map was made from, in words; empty if unknown.
    """

    error_map: VolumetricMap
    limit: float
    name: str
    sha256: str
    made_from: str = ""

    @property
    def words(self) -> str:
        """Say that targets are corrected, and by what."""
        origin = f", made from {self.made_from}" if self.made_from else ""
        return f"targets are corrected by {self.name} (SHA-256 {self.sha256}){origin}"

    def sent(self, target: Point) -> Point:
        """Return where to send the machine so that its tool comes to a target, m.

        Raises:
            ValueError: the error is not known there, or larger than the limit; says which.
        """
        wanted = np.array([target])
        found = target_for(self.error_map, wanted)[0]
        change = np.abs(found - wanted[0])
        if not np.all(np.isfinite(change)):
            x, y, z = target
            raise ValueError(
                f"the target {x:g}, {y:g}, {z:g} m cannot be corrected: {self.name} does not"
                " contain the error there"
            )
        axis = int(np.argmax(change))
        if change[axis] > self.limit:
            raise Refusal(
                f"the correction of {AXES[axis]} would be {change[axis] * 1e6:.1f} µm, which is"
                f" more than correction_limit, {self.limit * 1e6:g} µm",
                fault="out_of_range",
            )
        x, y, z = found.tolist()
        return x, y, z

    def nominal(self, position: Point) -> Point:
        """Return the place that a position of the controller is meant for, m; NaN if not known."""
        x, y, z = place_of(self.error_map, np.array([position]))[0].tolist()
        return x, y, z
