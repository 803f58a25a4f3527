"""The volume in which a machine may go."""

from dataclasses import dataclass

import numpy as np

from stepdiag_ros.metrology.geometry import Vector


@dataclass(frozen=True)
class Box:
    """Where the machine may go.

    Attributes:
        low: lower limits of X, Y, Z, machine coordinates, m, shape (3,).
        high: upper limits, m, shape (3,).
    """

    low: Vector
    high: Vector

    def __post_init__(self) -> None:
        if self.low.shape != (3,) or self.high.shape != (3,) or not np.all(self.low < self.high):
            raise ValueError("the volume needs three lower limits, each below its upper limit")
