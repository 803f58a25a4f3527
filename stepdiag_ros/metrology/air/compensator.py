"""Compensation of readings for the air, reading by reading: on line by a node, or from a bag.

Source of the formula: ``compensation.compensated_displacement``. It needs the count since a zero,
the path to the mirror at that zero, and the index of the air then and now. The zero of the
instrument itself may lie anywhere; here it is the first good reading after beam and mirror were set
up, at the place where the machine then stands.
"""

from dataclasses import replace
from math import isnan, nan

import numpy as np

from stepdiag_ros.metrology.air.compensation import compensated_displacement
from stepdiag_ros.metrology.air.index import DEFAULT_EQUATION, HELIUM_NEON_WAVELENGTH, index_of
from stepdiag_ros.metrology.beam import BeamPath, FixedBeam
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.samples import SampleBlock

COMPENSATIONS = ("instrument", "own", "off")
"""Who compensates: the instrument, with what it knows of the air; we, with the weather sensors;
nobody, so that the displacements are those of the count in vacuum wavelengths."""

_GOOD = 0
_UNKNOWN = Environment()


class Compensator:
    """Compensates readings of one instrument.

    Args:
        kind: one of ``COMPENSATIONS``.
        dead_path: from the interferometer's reference to the mirror at the first stop of the line,
            m; 0: the mirror stands at the reference there.
        wavelength: of the laser, in vacuum, m.
        equation: for the refractive index, one of ``index.EQUATIONS``.

    Raises:
        ValueError: there is no such kind.
    """

    def __init__(
        self,
        kind: str,
        dead_path: float = 0.0,
        wavelength: float = HELIUM_NEON_WAVELENGTH,
        equation: str = DEFAULT_EQUATION,
    ) -> None:
        if kind not in COMPENSATIONS:
            known = ", ".join(COMPENSATIONS)
            raise Refusal(f"'{kind}' is not a compensation; expected {known}", fault="unknown")
        self.kind = kind
        self._dead_path = dead_path
        self._wavelength = wavelength
        self._equation = equation
        self._beam: BeamPath = FixedBeam(np.zeros(3))
        self._start: Vector = np.zeros(3)
        self._position: Vector | None = None
        self._since, self._wants_zero = -1, True
        self._raw_at_zero = nan
        self._path_at_zero = nan
        self._index_at_zero = nan
        # The air of the last reading, its index, and that air without what no index needs.
        self._air = _UNKNOWN
        self._index = nan
        self._rest = _UNKNOWN

    def align(self, time: int, beam: BeamPath, start: Vector) -> None:
        """Take note that beam and mirror are set up again; the next good reading is the zero.

        Args:
            time: ns; readings from before do not count.
            beam: nominal, of the line.
            start: machine coordinates of the first stop, to which the dead path belongs, m.
        """
        self._beam, self._start = beam, np.asarray(start, dtype=np.float64)
        self._since, self._wants_zero = time, True

    def move(self, position: Vector | tuple[float, float, float]) -> None:
        """Take the actual position of the axes, m."""
        self._position = np.asarray(position, dtype=np.float64)

    def reading(self, reading: Reading, environment: Environment) -> Reading:
        """Return a reading with the displacement that is to be used, and the air behind it.

        Args:
            reading: of the instrument.
            environment: values of the weather sensors at its time.
        """
        self._take_air(environment)
        if self.kind == "instrument":
            if not _nothing(reading.environment):
                return reading
            # Which air the instrument took is its own secret.
            return reading._replace(environment=self._rest)
        if self._wants_zero and reading.status == _GOOD and reading.time > self._since:
            self._set_zero(reading.raw_displacement)
        scale, offset = self._scale_and_offset()
        return reading._replace(
            compensated_displacement=reading.raw_displacement * scale + offset,
            environment=self._environment,
        )

    def block(self, block: SampleBlock, environment: Environment) -> SampleBlock:
        """Return a block of samples with the compensation that is to be used (see ``reading``)."""
        self._take_air(environment)
        if self.kind == "instrument":
            if not _nothing(block.environment):
                return block
            return replace(block, environment=self._rest)
        if self._wants_zero and block.last_time > self._since:
            good = np.flatnonzero(np.broadcast_to(block.status == _GOOD, len(block)))
            if len(good):
                self._set_zero(float(block.raw_displacement[good[0]]))
        scale, offset = self._scale_and_offset()
        return replace(block, scale=scale, offset=offset, environment=self._environment)

    @property
    def _environment(self) -> Environment:
        """Return the air that is compensated for."""
        return self._air if self.kind == "own" else self._rest

    def _scale_and_offset(self) -> tuple[float, float]:
        """Return a and b (m): the compensated displacement is a times the raw one plus b."""
        if self.kind == "off":
            return 1.0, 0.0
        if isnan(self._index_at_zero):
            # A zero is arbitrary: the first known air after it serves as well as that at it.
            self._index_at_zero = self._index
        at_zero = compensated_displacement(
            -self._raw_at_zero, self._path_at_zero, self._index, self._index_at_zero
        )
        return 1.0 / self._index, at_zero

    def _set_zero(self, raw: float) -> None:
        if isnan(raw):
            return
        self._wants_zero = False
        place = self._start if self._position is None else self._position
        self._raw_at_zero = raw
        self._path_at_zero = self._beam.path(place, self._start, self._dead_path)
        self._index_at_zero = self._index

    def _take_air(self, environment: Environment) -> None:
        if environment is self._air:
            return
        self._air = environment
        self._index = index_of(environment, self._wavelength, self._equation)
        self._rest = Environment(material_temperature=environment.material_temperature)


def _nothing(environment: Environment) -> bool:
    return all(isnan(value) for value in environment)
