"""What goes into the evaluation of a pass on the fly, and what comes out."""

from dataclasses import dataclass
from enum import Enum
from math import isfinite, nan

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from stepdiag_ros.metrology.geometry import Vector

Instants = NDArray[np.int64]
Flags = NDArray[np.bool_]
Places = NDArray[np.intp]


class PassFault(Enum):
    """Why a node, or a whole pass, has no value."""

    BEAM_LOST = "the beam was lost"
    READINGS_MISSING = "readings are missing"
    POSITION_GAP = "the stream of positions has a gap"
    CLOCK_STEP = "a clock stepped"
    BLENDED_CORNER = "the controller blended the corner"
    FEED_CHANGED = "the feed changed"
    NO_POSITIONS = "positions come too seldom"
    NOT_JOINED = "readings and positions do not fit"


@dataclass(frozen=True)
class PassRecord:
    """Readings and positions of one pass, from its first stop to its last.

    Attributes:
        targets: nodes in the order of the pass, m, shape (moves + 1, 3).
        direction: of the beam, away from the laser, unit vector, shape (3,).
        position_times: ns, shape (n,).
        positions: actual X Y Z, m, shape (n, 3).
        reading_times: ns, shape (m,).
        sequences: of the readings, shape (m,).
        displacements: compensated, m, shape (m,); NaN if the air is not known.
        statuses: STATUS_* of InterferometerReading.msg, shape (m,).
        corner: a corner counts as reached exactly within this distance, m.
        noise_limit: standard deviation of a reading in the corners, without the vibration, above
            which the pass is refused, m.
    """

    targets: Vector
    direction: Vector
    position_times: Instants
    positions: Vector
    reading_times: Instants
    sequences: Instants
    displacements: Vector
    statuses: NDArray[np.uint8]
    corner: float = 5e-6
    noise_limit: float = 1e-6

    @property
    def moves(self) -> int:
        """Return the number of moves."""
        return len(self.targets) - 1


@dataclass(frozen=True)
class Finding:
    """A fault and the moves, from 1, that it makes unusable; none: the whole pass."""

    fault: PassFault
    text: str
    moves: frozenset[int] = frozenset()


@dataclass(frozen=True)
class AxisDelay:
    """By how much readings are stamped later than the positions of the axes that move, s.

    The clocks' offset, the time on the way, filters and the lag of the encoder behind the machine
    are all in it.
    """

    axis: str
    delay: float
    standard_uncertainty: float


@dataclass(frozen=True)
class Vibration:
    """The strongest vibration of the mirror against the laser; all NaN: none was found.

    Attributes:
        frequency: Hz.
        amplitude: root mean square over the moves of the amplitude in each, m.
        standard_uncertainty: of the amplitude, m.
    """

    frequency: float = nan
    amplitude: float = nan
    standard_uncertainty: float = nan

    @property
    def found(self) -> bool:
        """Say whether there is one."""
        return isfinite(self.frequency)


@dataclass(frozen=True)
class Moved:
    """What a line that was measured on the fly states beside the values of its nodes.

    Attributes:
        delays: of each axis, or group of axes, that moved alone.
        vibration: of the mirror.
        common: largest part of a node's standard uncertainty that comes from the delays, and so is
            common to the line, m.
    """

    delays: tuple[AxisDelay, ...]
    vibration: Vibration
    common: float


@dataclass(frozen=True)
class MoveCurve:
    """Error along the beam between two nodes, as coefficients of ``shapes``.

    Attributes:
        move: from 1.
        coefficients: m, shape (2 + BENDS,).
        covariance: m², shape (2 + BENDS, 2 + BENDS).
    """

    move: int
    coefficients: Vector
    covariance: Vector

    def at(self, part: Vector) -> tuple[Vector, Vector]:
        """Return the error (m) and its standard uncertainty at parts 0..1 of the move.

        The error is the reading less the way of a perfect machine from the pass's first node.
        """
        basis = shapes(part)
        variance = np.sum((basis @ self.covariance) * basis, axis=-1)
        return basis @ self.coefficients, np.sqrt(np.maximum(variance, 0.0))


BENDS = 3
"""Of the error between two nodes."""


def shapes(part: Vector) -> Vector:
    """Return the functions that make up an error between two nodes, shape (..., 2 + BENDS).

    Linear from node to node, and bends that vanish at both: ξ(1-ξ) times Legendre's polynomials.
    """
    rest = 1.0 - part
    bends = (part * rest)[..., np.newaxis] * legvander(rest - part, BENDS - 1)
    return np.concatenate((rest[..., np.newaxis], part[..., np.newaxis], bends), axis=-1)


@dataclass(frozen=True)
class NodeSource:
    """What a node's value was taken from: readings up to the next move, and when it stood there.

    Attributes:
        time: of the stay at the corner, ns.
        readings: of the move to the node and the stay there.
        first_sequence: of these readings.
        last_sequence: of these readings.
        start: of these readings, ns.
        end: of these readings, ns.
    """

    time: int
    readings: int
    first_sequence: int
    last_sequence: int
    start: int
    end: int


@dataclass(frozen=True)
class MovingPass:
    """What a pass says about its nodes.

    Attributes:
        displacement: reading at rest at each node, in the zero of the instrument, m, shape (n,);
            NaN where a node has none.
        covariance: of the displacements, m², shape (n, n); NaN where a node has none.
        reasons: why a node has no value, one each; empty if it has.
        findings: the faults that were found.
        sources: of each node; empty where the whole pass is refused.
        delays: of each axis, or group of axes, that moves alone.
        vibration: of the mirror.
        common: largest part of a node's standard uncertainty that comes from the delays, and so is
            common to the pass, m.
        noise: standard deviation of a reading at constant feed, m.
        curves: of the moves that have a value.
    """

    displacement: Vector
    covariance: Vector
    reasons: tuple[str, ...]
    findings: tuple[Finding, ...]
    sources: tuple[NodeSource, ...] = ()
    delays: tuple[AxisDelay, ...] = ()
    vibration: Vibration = Vibration()
    common: float = nan
    noise: float = nan
    curves: tuple[MoveCurve, ...] = ()

    @property
    def moved(self) -> Moved | None:
        """Return what the pass states beside its nodes; None of a refused one."""
        return Moved(self.delays, self.vibration, self.common) if self.delays else None

    @property
    def standard_uncertainty(self) -> Vector:
        """Return that of each node, m, shape (n,)."""
        root: Vector = np.sqrt(np.diagonal(self.covariance))
        return root


def refused(nodes: int, *findings: Finding) -> MovingPass:
    """Return a pass without any value."""
    return MovingPass(
        displacement=np.full(nodes, nan),
        covariance=np.full((nodes, nodes), nan),
        reasons=(findings[-1].text,) * nodes,
        findings=findings,
    )
