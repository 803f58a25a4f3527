"""Readings in the form that the solvers need: which nodes, which setup, how certain.

Readings of one setup share one alignment and one unknown zero. Their noise is independent;
differences between them are not. Where readings were rounded so coarsely that their repeats cannot
show it (``rounding``), all readings at a place share that error, and each is given the uncertainty
with which their mean has it in full.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.direct import DirectMeasurement
from stepdiag_ros.metrology.geometry import AXES, Vector, beam_direction, line_signs, moving_axis
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement
from stepdiag_ros.metrology.plan import DIAGONAL, FORWARD, LINEAR, Volume
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.rounding import NEGLIGIBLE, reading_step, shared_rounding
from stepdiag_ros.metrology.solvers.result import NotDeterminable
from stepdiag_ros.metrology.units import IN_MICRO

Integers = NDArray[np.int64]

_OFF_GRID = 1e-4
"""Share of a step by which a stop may lie beside its node."""
_ELSEWHERE = 1e-5
"""Standing axes of one setup may differ by less, m; no lever shows such a distance."""
_CONSPICUOUS = 2.0
_COARSE = 5e-7
"""Step of readings, m, from which a remark is made: u of the rounding is 0.14 µm and more."""


@dataclass(frozen=True)
class Setup:
    """One alignment of laser and mirror, with one zero.

    Attributes:
        name: identity.
        line: name of its line.
        signs: sense in which each axis runs, 0 where it stands, shape (3,).
        direction: nominal unit vector of the beam, shape (3,).
        start: the line's first stop of its forward sense, from the first corner of the box, m,
            shape (3,); where the axes stand that do not move.
        mirror_offset: of the mirror from its usual place on the tool, m, shape (3,).
    """

    name: str
    line: str
    signs: Integers
    direction: Vector
    start: Vector
    mirror_offset: Vector = field(default_factory=lambda: np.zeros(3))

    @property
    def diagonal(self) -> bool:
        """Say whether more than one axis moves, so that a tilt of the setup is seen."""
        return int(np.count_nonzero(self.signs)) > 1


@dataclass(frozen=True)
class Observations:
    """All readings that have a value, one entry a stop, in the order of measurement.

    Attributes:
        volume: the measured box.
        setups: in the order of their first reading.
        setup: index into ``setups``, shape (n,).
        passes: index of the line (one pass), shape (n,).
        stop: index of the stop in its pass, shape (n,).
        node: node of X, Y, Z that the axis stands at, -1 for an axis that does not move in the
            setup, shape (n, 3).
        displacement: m, shape (n,).
        uncertainty: standard uncertainty of each, m, shape (n,); NaN everywhere where unknown.
        lines: number of lines with at least one reading.
        direct: what was measured directly beside the lines; None if nothing was.
        step: that readings come in, m; 0 if they are not rounded.
        rounding: standard deviation of the rounding error that all readings at a place share, m.
    """

    volume: Volume
    setups: tuple[Setup, ...]
    setup: Integers
    passes: Integers
    stop: Integers
    node: Integers
    displacement: Vector
    uncertainty: Vector
    lines: int
    direct: DirectMeasurement | None = None
    step: float = 0.0
    rounding: float = 0.0

    @cached_property
    def noise_known(self) -> bool:
        """Say whether the readings came with standard uncertainties."""
        return bool(np.all(np.isfinite(self.uncertainty)))

    @cached_property
    def position(self) -> Vector:
        """Return commanded positions of all axes from the first corner, m, shape (n, 3)."""
        starts = np.array([setup.start for setup in self.setups])[self.setup]
        placed: Vector = np.where(self.node < 0, starts, self.node * np.asarray(self.volume.step))
        return placed

    @cached_property
    def way(self) -> Vector:
        """Return commanded positions from the first forward stop of each line, m, shape (n, 3)."""
        starts = np.array([setup.start for setup in self.setups])[self.setup]
        covered: Vector = self.position - starts
        return covered

    @cached_property
    def reach(self) -> Vector:
        """Return commanded positions from where the beam meets the mirror at first, m, (n, 3).

        The arms of rotations begin there: at the line's first forward stop, or beside it as far as
        the mirror is mounted elsewhere.
        """
        mounts = np.array([setup.mirror_offset for setup in self.setups])[self.setup]
        reach: Vector = self.way - mounts
        return reach

    @cached_property
    def excess(self) -> Vector:
        """Return the readings minus those of a perfect machine and setup, m, shape (n,)."""
        directions = np.array([setup.direction for setup in self.setups])[self.setup]
        beyond: Vector = self.displacement - np.sum(directions * self.way, axis=1)
        return beyond

    def shows(self, straightness: str) -> bool:
        """Say whether anything speaks of a straightness: a line along which both its axes move."""
        signs = np.array([setup.signs for setup in self.setups])
        both = signs[:, moving_axis(straightness)] * signs[:, AXES.index(straightness[2])]
        return bool(np.any(both)) or (
            self.direct is not None and straightness in self.direct.curves
        )

    def groups(self) -> tuple[Integers, Integers]:
        """Group readings of the same setup at the same nodes: repeats of one another.

        Returns:
            index of each reading's group, shape (n,), and the first reading of each group, shape
            (groups,).
        """
        return self._grouped(self.setup)

    def _grouped(self, key: Integers) -> tuple[Integers, Integers]:
        size = self.volume.blocks + 2
        for axis in range(3):
            key = key * size + self.node[:, axis] + 1
        _, first, group = np.unique(key, return_index=True, return_inverse=True)
        return group.reshape(-1), first

    @cached_property
    def zeros(self) -> Integers:
        """Return the zero that each reading shares, as an index from 0, shape (n,).

        The zero of a laser wanders by 0.1 to 0.2 µm from pass to pass, so every pass has a free
        zero of its own. Passes of a setup that stop at the same nodes with the same weights may be
        averaged first, which leaves one zero for the mean pass: their own zeros change nothing but
        the scatter about it.
        """
        starts = np.flatnonzero(np.diff(self.passes, prepend=-1))
        ends = np.append(starts[1:], len(self.passes))
        # One number for the node of all axes, the last axis counting most.
        size = self.volume.blocks + 2
        places = (self.node + 1) @ np.array([1, size, size**2])
        keys: dict[tuple[int, bytes], int] = {}
        zero = np.empty(len(starts), dtype=np.int64)
        for number, (start, end) in enumerate(zip(starts, ends, strict=True)):
            place = start + np.argsort(places[start:end], kind="stable")
            weight = self.uncertainty[place]
            ratio = np.round(weight / weight[0], 9) if self.noise_known else weight[:0]
            alike = places[place].tobytes() + ratio.tobytes()
            key = (int(self.setup[start]), alike)
            zero[number] = keys.setdefault(key, len(keys))
        shared: Integers = np.repeat(zero, ends - starts)
        return shared

    @cached_property
    def averaged(self) -> tuple[Integers, Integers]:
        """Group readings of the same zero at the same nodes, which may be averaged.

        Returns:
            as ``groups``.
        """
        return self._grouped(self.zeros)

    def pass_scatter(self, weight: Vector) -> tuple[Vector, int]:
        """Return what is left of the readings beyond their averaged places and their passes' zeros.

        Args:
            weight: of each reading, shape (n,): 1/u².

        Returns:
            residuals, m, shape (n,), and their degrees of freedom.
        """
        return self._scatter(self.zeros, weight)

    def _scatter(self, key: Integers, weight: Vector) -> tuple[Vector, int]:
        """Return what is left of readings beyond their places and passes; see ``pass_scatter``."""
        group, first = self._grouped(key)
        _, pass_of = np.unique(self.passes, return_inverse=True)
        pass_of = pass_of.reshape(-1)
        left = self.displacement
        for cell in (group, pass_of):
            mean = np.bincount(cell, weight * left) / np.bincount(cell, weight)
            left = left - mean[cell]
        further = int(pass_of[-1]) + 1 - len(np.unique(key))
        return left, len(group) - len(first) - further

    def with_rounding(self, step: float, forward: NDArray[np.bool_]) -> "Observations":
        """Return the readings with the uncertainty that rounding gives them.

        Args:
            step: that they come in, m; 0 if they are not rounded.
            forward: whether each belongs to a forward pass, shape (n,).
        """
        # Along an axis, errors that are smaller than the step show nowhere.
        if not step > 0.0 or np.ptp(self.excess) <= 0.5 * step:
            return self
        left, freedom = self._scatter(2 * self.setup + forward, np.ones(len(forward)))
        own = self.uncertainty
        if freedom > 0:
            scatter = float(np.sqrt(np.sum(left**2) / freedom))
            own = own if self.noise_known else np.full(len(own), scatter)
        else:
            scatter = float(np.median(own)) if self.noise_known else 0.0
        rounding = shared_rounding(scatter, step)
        passes = len(forward) / len(self.groups()[1])
        shared = np.sqrt(passes) * rounding
        if shared < NEGLIGIBLE * scatter:
            return replace(self, step=step)
        return replace(self, uncertainty=np.hypot(own, shared), step=step, rounding=rounding)

    @property
    def rounding_remarks(self) -> list[str]:
        """Say that coarse rounding hides a part of itself; empty if it does not."""
        if self.step < _COARSE or self.rounding < 0.1 * self.step:
            return []
        return [
            f"The readings come in steps of {self.step * IN_MICRO:g} µm, and repeats show little of"
            f" the rounding: {self.rounding * IN_MICRO:.2g} µm of standard uncertainty was added to"
            " the mean at each place. Note one more digit."
        ]

    def pure_error(self, weight: Vector | None = None) -> tuple[float, int]:
        """Return sum of squares (m²) and degrees of freedom of the repeats within groups.

        A pass's own zero is not part of it.

        Args:
            weight: of each reading, shape (n,): 1/u² makes χ² of the sum; all alike if None.
        """
        weight = np.ones(len(self.setup)) if weight is None else weight
        left, freedom = self.pass_scatter(weight)
        return float(np.sum(weight * left**2)), freedom


def observe(measurement: Measurement) -> Observations:
    """Collect the readings of a measurement.

    Raises:
        NotDeterminable: there is no reading at all.
        ValueError: a stop that is not a node of the volume; lines of different directions or places
            in one setup.
    """
    volume = measurement.volume
    index: dict[str, int] = {}
    setups: list[Setup] = []
    setup, passes, stops, nodes, values, uncertainties, forward = [], [], [], [], [], [], []
    for number, line in enumerate(measurement.lines):
        good = np.flatnonzero(np.isfinite(line.displacement))
        if len(good) == 0:
            continue
        if line.setup not in index:
            index[line.setup] = len(setups)
            signs = line_signs(line.line.name)
            direction = beam_direction(line.line.name, np.asarray(volume.step))
            start = _start(line, volume, signs)
            mount = np.array(line.line.mirror_offset)
            setups.append(Setup(line.setup, line.line.name, signs, direction, start, mount))
        used = setups[index[line.setup]]
        if used.line != line.line.name:
            raise Refusal(
                f"setup '{line.setup}' holds lines '{used.line}' and '{line.line.name}': "
                "one setup has one beam direction",
                fault="mismatch",
                aspect="beam",
            )
        if np.max(np.abs(_start(line, volume, used.signs) - used.start)) > _ELSEWHERE:
            raise Refusal(
                f"setup '{line.setup}' holds lines '{line.line.name}' at different places: one "
                "setup stands at one place; give each place a setup of its own",
                fault="mismatch",
                aspect="place",
            )
        setup.append(np.full(len(good), index[line.setup]))
        passes.append(np.full(len(good), number))
        stops.append(good)
        nodes.append(nodes_of(line, volume, used.signs)[good])
        values.append(line.displacement[good])
        uncertainties.append(_line_uncertainty(line.standard_uncertainty[good]))
        forward.append(np.full(len(good), line.line.direction == FORWARD))
    if not setups:
        raise NotDeterminable("no line has a settled stop yet", fault="too_few")
    uncertainty = np.concatenate(uncertainties)
    if not np.all(np.isfinite(uncertainty)):
        uncertainty = np.full(len(uncertainty), np.nan)
    displacement = np.concatenate(values)
    observations = Observations(
        volume=volume,
        setups=tuple(setups),
        setup=np.concatenate(setup),
        passes=np.concatenate(passes),
        stop=np.concatenate(stops),
        node=np.concatenate(nodes),
        displacement=displacement,
        uncertainty=uncertainty,
        lines=len(values),
        direct=measurement.direct,
    )
    return observations.with_rounding(reading_step(displacement), np.concatenate(forward))


def _start(line: MeasuredLine, volume: Volume, signs: Integers) -> Vector:
    """Return where a line's forward sense starts, from the first corner of the box, m."""
    standing = line.target[0] - np.asarray(volume.origin)
    first = np.where(signs < 0, volume.blocks * np.asarray(volume.step), 0.0)
    start: Vector = np.where(signs == 0, standing, first)
    return start


def nodes_of(line: MeasuredLine, volume: Volume, signs: Integers) -> Integers:
    """Return the node of each moving axis at each stop, -1 for standing axes, shape (stops, 3).

    Raises:
        ValueError: a moving axis stands beside the nodes of the volume at a stop.
    """
    nearest, beside = _nearest_nodes(line, volume, signs)
    if np.any(beside):
        if _is_uneven(line):
            raise Refusal(
                f"line {line.line}: its targets are not evenly spaced, and error curves and the"
                " diagnosis need targets at the nodes of the measured volume. 'stepdiag iso230'"
                " evaluates this line",
                fault="mismatch",
                about=line.line.name,
                aspect="spacing",
            )
        stop, axis = np.argwhere(beside)[0]
        raise Refusal(
            f"line {line.line}: stop {stop} has {AXES[axis]} = {line.target[stop, axis]:g} m, "
            "which is not a node of the measured volume; the line and the volume contradict each"
            " other",
            fault="mismatch",
            aspect="node",
        )
    nodes: Integers = np.where(signs != 0, nearest, -1).astype(np.int64)
    return nodes


def unevenly_spaced(lines: Iterable[MeasuredLine], volume: Volume) -> tuple[str, ...]:
    """Return the lines whose targets are not evenly spaced and lie beside the nodes of a volume.

    Args:
        lines: as they were measured.
        volume: the measured box.

    Returns:
        names such as ``x`` or ``ppp``, each once, in the order of measurement.
    """
    return tuple(
        dict.fromkeys(
            line.line.name
            for line in lines
            if _is_uneven(line)
            and np.any(_nearest_nodes(line, volume, line_signs(line.line.name))[1])
        )
    )


def _nearest_nodes(
    line: MeasuredLine, volume: Volume, signs: Integers
) -> tuple[Vector, NDArray[np.bool_]]:
    """Return the nearest node of each axis, and whether a moving axis stands beside it."""
    counted = (line.target - np.asarray(volume.origin)) / np.asarray(volume.step)
    nearest: Vector = np.rint(counted)
    beside = (np.abs(counted - nearest) > _OFF_GRID) | (nearest < 0) | (nearest > volume.blocks)
    return nearest, beside & (signs != 0)


def _is_uneven(line: MeasuredLine) -> bool:
    """Say whether the targets of a line along an axis or a diagonal lie beside an even grid."""
    if line.line.kind not in (LINEAR, DIAGONAL) or len(line.target) < 3:
        return False
    even = np.linspace(line.target[0], line.target[-1], len(line.target))
    step = np.max(np.abs(even[1] - even[0]))
    return bool(np.max(np.abs(line.target - even)) > _OFF_GRID * step)


def _line_uncertainty(own: Vector) -> Vector:
    """Return the uncertainties to weight a line's stops with, m; NaN if they are not known.

    What is written beside a stop is itself an estimate from a few readings; weighting by it would
    favour stops whose readings happened to agree. So the stops of a line get their common root mean
    square, except those more than twice as uncertain as the median, which keep their own.
    """
    # Not np.median: its first call in a process imports numpy.ma, which takes longer than a solve.
    conspicuous = own > _CONSPICUOUS * np.sort(own)[len(own) // 2]
    common = np.sqrt(np.mean(own[~conspicuous] ** 2))
    if not np.all(np.isfinite(own)) or common <= 0.0:
        return np.full(len(own), np.nan)
    return np.where(conspicuous, own, common)


ALL_READINGS = slice(None)


@dataclass(frozen=True)
class BlockMeans:
    """Mean displacement of each single-axis move over repeats, directions and move orders.

    Attributes:
        lines: names of the lines.
        weights: displacement of axis i over its interval k along line L's forward sense is
            ``weights[L, i, k] @ readings``, shape (lines, 3, blocks, n); zero for axes that stand.
            Of some readings alone where only these were asked for.
    """

    lines: tuple[str, ...]
    weights: Vector

    def excess(self, observations: Observations) -> Vector:
        """Return the displacements beyond the nominal ones, m, shape (lines, 3, blocks)."""
        found: Vector = self.weights @ observations.excess
        return found


def block_means(
    observations: Observations, lines: tuple[str, ...], readings: slice = ALL_READINGS
) -> BlockMeans:
    """Average the displacements of every single-axis move, R_x,ppp(k) and its like (IH eq. 1).

    The interval k counts along the axis, so that the block N-k+1 of an axis that runs backwards is
    its interval k, as Ibaraki & Hata 2010, eq. 2, has it. Moves between rejected stops are left
    out.

    Args:
        observations: the readings.
        lines: names of the lines.
        readings: those of which the weights are wanted; the others have theirs all the same.

    Raises:
        NotDeterminable: a line is missing, or one of its moves was never measured; the text says
            which.
    """
    blocks = observations.volume.blocks
    start, end, _ = readings.indices(len(observations.displacement))
    names = np.array([setup.line for setup in observations.setups])[observations.setup]
    missing = [line for line in lines if line not in names]
    if missing:
        raise NotDeterminable(
            f"needs the lines {', '.join(lines)}; missing: {', '.join(missing)}",
            fault="missing",
            about=", ".join(missing),
            aspect="lines",
        )
    weights = np.zeros((len(lines), 3, blocks, end - start))
    for row, line in enumerate(lines):
        signs = line_signs(line)
        before = np.flatnonzero(
            (names[:-1] == line)
            & (observations.passes[:-1] == observations.passes[1:])
            & (observations.stop[1:] == observations.stop[:-1] + 1)
        )
        moved = observations.node[before + 1] - observations.node[before]
        single = np.sum(np.abs(moved), axis=1) == 1
        before, moved = before[single], moved[single]
        axis = np.argmax(np.abs(moved), axis=1)
        rows = np.arange(len(before))
        interval = np.minimum(observations.node[before, axis], observations.node[before + 1, axis])
        sense = moved[rows, axis] * signs[axis]
        number = np.zeros((3, blocks))
        np.add.at(number, (axis, interval), 1.0)
        for moving in np.flatnonzero(signs):
            gap = np.flatnonzero(number[moving] == 0)
            if len(gap):
                raise NotDeterminable(
                    f"the move of {AXES[moving]} alone over its interval {gap[0] + 1} was not "
                    f"measured on {line}; measure it as a step diagonal again, or use"
                    " least_squares",
                    fault="missing",
                    aspect="move",
                )
        share = sense / number[axis, interval]
        for place, weight in ((before + 1, share), (before, -share)):
            here = (place >= start) & (place < end)
            where = (axis[here], interval[here], place[here] - start)
            np.add.at(weights[row], where, weight[here])
    return BlockMeans(lines, weights)
