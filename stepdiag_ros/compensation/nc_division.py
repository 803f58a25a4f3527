"""Divides a move into straight pieces so short that the tool stays within a tolerance of its way.

A control moves its axes straight from one corrected place to the next. The tool is then at
q + e(q), and what remains of the error at a part t of the way is q(t) + e(q(t)) - w(t), with w the
wanted way (line or arc). The map is made of curves that are straight between nodes, times levers
that change evenly along a line, and of learned shapes that are smooth between their kinks: between
two planes of nodes or kinks the remaining error is a low polynomial of t, or nearly so. It is
looked at in ``POINTS`` places of every piece and at these planes; of a parabola over a piece these
miss 1 / POINTS² of its height at most, less than 2 %, and a reserve of 5 % is kept.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stepdiag_ros.compensation.nc_motion import Motion
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.target_correction import held_errors, place_of, target_for
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

POINTS = 8
"""In every piece, at which the remaining error is looked at, beside the planes of nodes."""
RESERVE = 0.95
"""Part of the tolerance that the places looked at may use."""
MOST_PIECES = 200_000
_FIRST_SWEEP = np.pi / 6.0


class Pieces(NamedTuple):
    """A divided move: parts of the way at the ends of the pieces, and where the axes are sent.

    Attributes:
        part: 0 … 1, shape (pieces + 1,).
        sent: machine coordinates, m, shape (pieces + 1, 3); the first is where the axes stand.
        remaining: largest remaining error that was found, m.
    """

    part: Vector
    sent: Vector
    remaining: float


@dataclass(frozen=True)
class Division:
    """How moves are divided.

    Attributes:
        error_map: of the machine; beyond its box the errors of its edge hold.
        tolerance: that the remaining error must not exceed along a feed move, m.
    """

    error_map: VolumetricMap
    tolerance: float

    def pieces(
        self, motion: Motion, start: Vector, end: Vector, rounded: Callable[[Vector], Vector]
    ) -> Pieces | None:
        """Divide a feed move.

        Args:
            motion: the wanted way.
            start: where the axes stand, m, shape (3,).
            end: target for the end of the way, m, shape (3,).
            rounded: makes places that the program can say out of any, m, shape (n, 3).

        Returns:
            the pieces; None if the tolerance cannot be kept. What remains is NaN, and nothing is
            divided, where the errors are not known.
        """
        count = 1 if motion.arc is None else int(np.ceil(abs(motion.arc.sweep) / _FIRST_SWEEP))
        part = np.linspace(0.0, 1.0, max(count, 1) + 1)
        kinks = self.kinks(motion)
        while len(part) <= MOST_PIECES:
            sent = np.vstack([start, np.empty((len(part) - 2, 3)), rounded(end[None, :])[0]])
            if len(part) > 2:
                sent[1:-1] = rounded(target_for(self.error_map, motion.at(part[1:-1])))
            worst = self.remaining(motion, part, sent, kinks)
            if not np.all(np.isfinite(worst)):
                return Pieces(part, sent, float("nan"))
            failing = worst > RESERVE * self.tolerance
            if not np.any(failing):
                return Pieces(part, sent, float(np.max(worst, initial=0.0)))
            if failing[0] and self._start_error(motion, start) > RESERVE * self.tolerance:
                return None
            middle = 0.5 * (part[:-1] + part[1:])[failing]
            part = np.sort(np.concatenate([part, middle]))
        return None

    def uncorrected(self, motion: Motion) -> float:
        """Return the largest error of a move that is made as it is, m."""
        part = np.unique(np.concatenate([np.linspace(0.0, 1.0, 65), self.kinks(motion)]))
        errors = held_errors(self.error_map, motion.at(part))
        return float(np.max(np.linalg.norm(errors, axis=1)))

    def kinks(self, motion: Motion) -> Vector:
        """Return the parts of a way at which it crosses planes of nodes or kinks, shape (n,)."""
        if motion.arc is not None:
            return self._kinks_of_arc(motion)
        found = []
        for axis in range(3):
            nodes = self.error_map.planes(axis)
            way = motion.end[axis] - motion.start[axis]
            if way != 0.0:
                part = (nodes - motion.start[axis]) / way
                found.append(part[(part > 0.0) & (part < 1.0)])
        return np.sort(np.concatenate(found)) if found else np.empty(0)

    def _kinks_of_arc(self, motion: Motion) -> Vector:
        """Find the crossings between close places; their exact part matters little."""
        part = np.linspace(0.0, 1.0, 721)
        places = motion.at(part)
        found = []
        for axis in range(3):
            nodes = self.error_map.planes(axis)
            cell = np.searchsorted(nodes, places[:, axis])
            for step in np.flatnonzero(np.diff(cell)):
                node = nodes[min(cell[step], cell[step + 1])]
                before, after = places[step, axis], places[step + 1, axis]
                share = (node - before) / (after - before)
                found.append(part[step] + share * (part[step + 1] - part[step]))
        return np.sort(np.array(found, dtype=np.float64))

    def remaining(self, motion: Motion, part: Vector, sent: Vector, kinks: Vector) -> Vector:
        """Return the largest remaining error of each piece, m, shape (pieces,).

        Args:
            motion: the wanted way.
            part: see ``Pieces``.
            sent: see ``Pieces``.
            kinks: parts of the way to look at, too.
        """
        inner = np.arange(POINTS + 1) / POINTS
        points = part[:-1, None] + inner * np.diff(part)[:, None]
        looked = np.concatenate([points.ravel(), part[1:], kinks])
        # A place between two pieces belongs to both; it is the end of the one before.
        piece = np.clip(np.searchsorted(part, looked, side="left") - 1, 0, len(part) - 2)
        share = (looked - part[piece]) / (part[piece + 1] - part[piece])
        axes = sent[piece] + share[:, None] * (sent[piece + 1] - sent[piece])
        error = np.linalg.norm(place_of(self.error_map, axes) - motion.at(looked), axis=1)
        worst = np.zeros(len(part) - 1)
        np.maximum.at(worst, piece, error)
        return worst

    def _start_error(self, motion: Motion, start: Vector) -> float:
        place = place_of(self.error_map, start[None, :])[0]
        return float(np.linalg.norm(place - motion.start))
