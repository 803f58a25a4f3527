"""Samples of a fast interferometer: blocks of them, as arrays, even in time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.refusal import Refusal

MOST_IN_BLOCK = 5000
"""Samples in one block, at most, so that no message holds up the others on its way."""

Bytes = NDArray[np.uint8]
Singles = NDArray[np.float32]


@dataclass(frozen=True)
class SampleBlock:
    """Samples that follow each other without a gap, with one zero and one known air.

    Attributes:
        time: of measurement of the first sample, ns.
        sequence: of the first sample; counts every sample of the instrument by one.
        period: from one sample to the next, s.
        zero: counts how often the zero was set; displacements with different numbers cannot be
            compared.
        scale: compensated displacement = scale · raw displacement + offset; NaN if the air is not
            known.
        offset: m; NaN if the air is not known.
        environment: that scale and offset are for.
        raw_displacement: m, in vacuum wavelengths, shape (n,).
        signal_strength: 0..1, shape (n,), or (1,) if it is that of all; NaN if it is unknown.
        status: STATUS_* of InterferometerReading.msg, shape (n,), or (1,) if it is that of all.
    """

    time: int
    sequence: int
    period: float
    zero: int
    scale: float
    offset: float
    environment: Environment
    raw_displacement: Vector
    signal_strength: Singles
    status: Bytes

    def __post_init__(self) -> None:
        count = len(self.raw_displacement)
        if count == 0 or not self.period > 0.0:
            raise Refusal(
                "a block needs at least one sample and a period above zero;"
                f" this one has {count} samples, {self.period:g} s apart",
                fault="too_few",
            )
        for name in ("signal_strength", "status"):
            told = len(getattr(self, name))
            if told not in (1, count):
                raise Refusal(
                    f"a block of {count} samples has {told} values of {name}: it needs one for each"
                    " sample, or one for all",
                    fault="mismatch",
                )

    def __len__(self) -> int:
        return len(self.raw_displacement)

    @property
    def end(self) -> int:
        """Return the sequence number of the sample that comes next."""
        return self.sequence + len(self)

    def time_of(self, sequence: int) -> int:
        """Return when the sample of that number was measured, ns."""
        return self.time + round((sequence - self.sequence) * self.period * 1e9)

    @property
    def last_time(self) -> int:
        """Return when the last sample was measured, ns."""
        return self.time_of(self.end - 1)
