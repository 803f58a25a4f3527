"""Worst plausible machines and their measurements: everything at once that a workshop has.

One machine has positioning (a line, three waves, a ball screw's period), six straightnesses, nine
angular errors, three squarenesses; its beams and mirrors are off; the zero of the readings wanders
from pass to pass; the air drifts, and the sensors that compensate for it err by as much as the
instrument description says. The sizes are those of a good machining centre in a good workshop.

Anybody may leave a part out (``without``), to learn what makes a band false.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import yaml

from stepdiag_ros.metrology.air import compensated_displacement, raw_displacement, refractive_index
from stepdiag_ros.metrology.cell import Misalignment, SimulatedCell, WeatherModel
from stepdiag_ros.metrology.forward import (
    SQUARENESS_SLOPES,
    ErrorCurves,
    perpendiculars,
    tool_point,
)
from stepdiag_ros.metrology.geometry import (
    BODY_DIAGONALS,
    CHAINS,
    CURVES,
    FACE_DIAGONALS,
    LINEAR_LINES,
    ROTATIONS,
    TRANSLATIONS,
    beam_direction,
    line_signs,
    moving_axis,
)
from stepdiag_ros.metrology.plan import DIAGONAL, Plan, Volume
from stepdiag_ros.metrology.plausible import Plausible
from stepdiag_ros.metrology.simulation import planned_run, read_again
from stepdiag_ros.metrology.solvers.summary import CurveEstimate, common_figures
from stepdiag_ros.metrology.uncertainty.instrument import NORMAL, Instrument, Spread
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

FIXED_AT_END = ("E_YX", "E_ZX", "E_YZ")
"""Curves that end at zero by definition of the frame (Ibaraki & Hata 2010, eq. 17)."""
PARTS = ("rotations", "straightness", "wander", "air")
"""What can be left out of a machine and its measurement."""
SLOPE, WAVES, SCREW = 10e-6, 1e-6, 0.3e-6
"""Positioning: m/m; m of the first wave, the second half as large, the third a third; m."""
STRAIGHTNESS = 0.7e-6
"""m, of the first wave; the others as in positioning."""
ANGLE, ANGULAR_WAVES = 3e-6, 1e-6
"""Angular errors: rad at the end of the travel; rad of the first wave."""
SQUARENESS_SIZE = 20e-6
NOISE = 0.1e-6
WANDER = (0.1e-6, 0.2e-6)
"""Standard deviation of a pass's zero, m, drawn evenly between these for each machine."""
TRAVEL = (0.12, 1.0)
"""m: the longest axis, evenly in its logarithm; the others 0.5 to 1 times as long."""
BEAM, MIRROR = 150e-6, 20e-6
"""Standard deviations of each angle of a beam, and of a mirror against it, rad."""
DEAD_PATH = 0.3
LOST_MOTION, REPEATABILITY = (0.5e-6, 3e-6), (0.2e-6, 0.5e-6)
"""m, of each axis, evenly; on the lines of ISO 230-2 and ISO 230-6 alone, whose parameters they
are: lost motion at a reversal, and standard deviation of a position from run to run."""
_INSTRUMENT = Path(__file__).parents[2] / "config" / "instruments" / "demo.yaml"
_FINE = 1e-3
"""m: the error motions are straight between places so far apart."""


def _waves(rng, share):
    made = np.zeros_like(share)
    for wave in (1, 2, 3):
        phase = rng.uniform(0.0, 2.0 * np.pi)
        size = rng.standard_normal() / wave
        made += size * (np.sin(2.0 * np.pi * wave * share + phase) - np.sin(phase))
    return made


def _curve(name, rng, way, without):
    share = way / way[-1]
    if name in ROTATIONS:
        made = ANGLE * rng.standard_normal() * share + ANGULAR_WAVES * _waves(rng, share)
        return 0.0 * made if "rotations" in without or name in without else made
    if name[2] != name[3]:
        made = STRAIGHTNESS * _waves(rng, share)
        return 0.0 * made if "straightness" in without else made
    pitch, phase = rng.choice([5e-3, 10e-3, 20e-3]), rng.uniform(0.0, 2.0 * np.pi)
    screw = np.sin(2.0 * np.pi * way / pitch + phase) - np.sin(phase)
    return SLOPE * rng.standard_normal() * way + WAVES * _waves(rng, share) + SCREW * screw


def _drawn(spread, rng):
    """Draw one value of what is known of an input: normal, or even within its limits."""
    size = spread.standard_uncertainty
    if spread.distribution == NORMAL:
        return size * rng.standard_normal()
    return size * rng.uniform(-np.sqrt(3.0), np.sqrt(3.0))


def known_instrument():
    """Return what the user knows of the instrument and, by class of machine, of its angles."""
    told = Instrument.from_mapping(yaml.safe_load(_INSTRUMENT.read_text()), str(_INSTRUMENT))
    return replace(told, angular_errors=Spread(ANGLE))


@dataclass(frozen=True)
class PlausibleMachine:
    """A machine with its laser, as it really is.

    Attributes:
        seed: that everything comes from.
        cell: errors of the machine, alignment of each setup.
        origin: first corner of the box, m.
        travel: of the box, m.
        wander: standard deviation of a pass's zero, m.
        noise_told: the readings come with their standard uncertainty.
        without: parts that are left out.
    """

    seed: int
    cell: SimulatedCell
    origin: tuple
    travel: tuple
    wander: float
    noise_told: bool
    without: tuple = ()

    @property
    def chain(self):
        return self.cell.chain

    @cached_property
    def instrument(self):
        return known_instrument()

    def plan(self, lines, blocks, passes=2, overrun=0.0, one_alignment=False):
        """Return a plan over the whole box, every line in both directions."""
        return Plan.from_mapping(
            {
                "origin_m": list(self.origin),
                "step_m": [length / blocks for length in self.travel],
                "blocks": blocks,
                "repeats": passes,
                "directions": ["forward", "backward"],
                "feed_m_per_s": 0.05,
                "overrun_m": overrun,
                "one_alignment_per_diagonal": one_alignment,
                "lines": lines,
            },
            f"plan of machine {self.seed}",
        )

    def steps(self, passes=2):
        """Linear lines and four step diagonals in one order of moves, as most users measure."""
        rng = np.random.default_rng([self.seed, 2])
        order = str(rng.choice(["XYZ", "YZX", "ZXY"]))
        lines = [
            {"kind": "linear", "names": list(LINEAR_LINES)},
            {"kind": "step_diagonal", "names": list(BODY_DIAGONALS), "orders": [order]},
        ]
        return self.plan(lines, int(rng.integers(5, 11)), passes)

    def orders(self, passes=2):
        """Three orders of moves, and linear lines at the corner and at the far edges."""
        rng = np.random.default_rng([self.seed, 3])
        far = {"x": (0, 1, 1), "y": (1, 0, 1), "z": (1, 1, 0)}
        lines = [
            {"kind": "linear", "names": list(LINEAR_LINES)},
            *(
                {
                    "kind": "linear",
                    "names": [name],
                    "offset_m": (self.travel * np.array(at)).tolist(),
                }
                for name, at in far.items()
            ),
            {
                "kind": "step_diagonal",
                "names": list(BODY_DIAGONALS),
                "orders": ["XYZ", "YZX", "ZXY"],
            },
        ]
        return self.plan(
            lines, int(rng.integers(4, 8)), passes, one_alignment=bool(rng.random() < 0.5)
        )

    def standard_lines(self, passes=5):
        """Linear lines, body and face diagonals, as ISO 230-2 and ISO 230-6 have them."""
        rng = np.random.default_rng([self.seed, 4])
        lines = [
            {"kind": "linear", "names": list(LINEAR_LINES)},
            {"kind": "diagonal", "names": [*BODY_DIAGONALS, *FACE_DIAGONALS]},
        ]
        return self.plan(lines, int(rng.integers(5, 11)), passes, overrun=2e-3)

    def measure(self, plan, day=0, effects=()):
        """Return what the laser reads, compensated with what its sensors tell.

        The plausible size of the rotations is told, as a user tells it who knows such machines.

        Args:
            plan: what is measured.
            effects: of the catalogue that act besides.
            day: on another day beams, air, noise and wander are others, the machine and the
                sensors' errors are not.
        """
        calibration = np.random.default_rng([self.seed, 5])
        errors = {name: self._error(name, calibration) for name in _CALIBRATED}
        rng = np.random.default_rng([self.seed, 6, day])
        cell = replace(self.on_day(day), effects=tuple(effects))
        exact = read_again(planned_run(plan, cell), cell)
        exact = replace(exact, lines=_zeroed(self._with_scatter(plan, exact.lines)))
        beams, zeros, lines = {}, {}, []
        for line in exact.lines:
            gradient, path = beams.setdefault(
                line.setup,
                (self._error("air_gradient", rng), self._error("dead_path_spread", rng)),
            )
            turbulence = self._error("turbulence", rng, len(line.time))
            told = line.environment + np.array(
                [errors["air_temperature"], errors["air_pressure"], errors["relative_humidity"], 0]
            )
            index = refractive_index(
                line.environment[:, 0] + gradient, line.environment[:, 1], line.environment[:, 2]
            ) * (1.0 + turbulence + errors["wavelength"])
            known = refractive_index(told[:, 0], told[:, 1], told[:, 2])
            first = zeros.setdefault(line.setup, (index[0], known[0]))
            count = raw_displacement(line.displacement, DEAD_PATH, index, first[0])
            read = compensated_displacement(count, DEAD_PATH + path, known, first[1])
            wander = self.wander * rng.standard_normal() * ("wander" not in self.without)
            read = read + wander + NOISE * rng.standard_normal(len(read))
            lines.append(
                replace(
                    line,
                    displacement=read,
                    standard_uncertainty=np.full(len(read), NOISE if self.noise_told else np.nan),
                    environment=told,
                    overrun=plan.overrun_of(line.line),
                )
            )
        return replace(exact, lines=_zeroed(lines), plausible=Plausible(rotation=ANGLE))

    def exact(self, plan):
        """Return the lines as a perfect laser reads them, well aligned, in still and known air."""
        cell = replace(self.cell, misalignment=Misalignment())
        made = read_again(planned_run(plan, cell), cell)
        lines = [replace(one, overrun=plan.overrun_of(one.line)) for one in made.lines]
        return replace(made, lines=_zeroed(self._with_scatter(plan, lines)))

    def _with_scatter(self, plan, lines):
        """Return lines with lost motion and repeatability, if the plan is of ISO 230."""
        if all(line.kind != DIAGONAL for line in plan.lines):
            return lines
        rng = np.random.default_rng([self.seed, 9])
        lost, spread = rng.uniform(*LOST_MOTION, 3), rng.uniform(*REPEATABILITY, 3)
        made = []
        for line in lines:
            beam = beam_direction(line.line.name, np.asarray(plan.volume.step))
            sense = np.sign(line.target[-1] - line.target[0])
            moved = 0.5 * lost * sense + spread * rng.standard_normal(line.target.shape)
            made.append(replace(line, displacement=line.displacement + moved @ beam))
        return made

    def on_day(self, day):
        """Return the cell with the alignments and the weather of a day."""
        rng = np.random.default_rng([self.seed, 7, day])
        weather = WeatherModel(
            air_temperature=20.0 + rng.uniform(-2.0, 2.0),
            air_temperature_drift=rng.uniform(-0.5, 0.5) / 3600.0,
            air_temperature_wave=rng.uniform(0.1, 0.4),
            air_pressure=101325.0 + rng.uniform(-2000.0, 2000.0),
            air_pressure_drift=rng.uniform(-100.0, 100.0) / 3600.0,
            relative_humidity=rng.uniform(0.3, 0.6),
        )
        return replace(self.cell, seed=1000 * self.seed + day, weather=weather)

    def _error(self, name, rng, count=None):
        drawn = (
            _drawn(getattr(self.instrument, name), rng)
            if count is None
            else np.array([_drawn(getattr(self.instrument, name), rng) for _ in range(count)])
        )
        return 0.0 * drawn if "air" in self.without else drawn

    def truth(self, volume):
        """Return what is true of the machine over a volume."""
        return Truth(self, volume)


_CALIBRATED = ("wavelength", "air_temperature", "air_pressure", "relative_humidity")
"""Errors of the instrument that are the same in all its readings, on every day."""


@dataclass(frozen=True)
class Truth:
    """What is true of a machine over a volume, in the frame of the results, exactly.

    Attributes:
        machine: of which it is true.
        volume: the measured box.
    """

    machine: PlausibleMachine
    volume: Volume

    @cached_property
    def curves(self):
        """All eighteen curves at the nodes."""
        return self.machine.cell.truth(self.volume)

    @cached_property
    def figures(self):
        """Squareness, positioning, straightness, angles, diagonals: name → value."""
        stacked = np.concatenate([self.curves[name] for name in CURVES])
        nothing = CurveEstimate(
            stacked, np.zeros((stacked.size,) * 2), np.zeros((stacked.size, 0)), CURVES
        )
        cell, step = self.machine.cell, np.asarray(self.volume.step)
        figures = common_figures(self.volume, nothing, (), cell.chain)
        made = {figure.name: figure.value for figure in figures}
        far = step * self.volume.blocks
        for line in BODY_DIAGONALS:
            signs = line_signs(line)
            ends = self.volume.origin + far * np.array([signs < 0, signs > 0])
            points, _ = tool_point(ends, cell.errors, cell.chain, np.asarray(cell.mirror_offset))
            gained = (points[1] - points[0]) - (ends[1] - ends[0])
            made[f"diagonal {line}"] = float(gained @ beam_direction(line, step))
        return made

    @cached_property
    def end_to_end(self):
        """Squareness by the slopes from end to end: name → right-handed rotation, rad."""
        return {
            name: factor * sum(self._slope(curve) for curve in pair)
            for name, (factor, pair) in SQUARENESS_SLOPES.items()
        }

    @cached_property
    def error_map(self):
        """The machine's error vectors in the box."""
        nodes = self.volume.all_nodes
        return VolumetricMap(nodes, self.curves, chain=self.machine.chain)

    def tilts(self, setup, line, day=0):
        """Return the two angles of the effective direction of a setup, rad.

        A frame that is turned by θ turns the machine and the setup together.
        """
        step = np.asarray(self.volume.step)
        nominal = beam_direction(line, step)
        corner = self.volume.origin + step * self.volume.blocks * (line_signs(line) < 0)
        alignment = self.machine.on_day(day).alignment(setup, line, self.volume.step, tuple(corner))
        (_, e_yx, e_zx), (_, e_yz, _) = (self._slopes(axis) for axis in (0, 2))
        turn = np.array([e_yz, e_zx, -e_yx])
        direction = alignment.mirror_normal - nominal + np.cross(turn, nominal)
        return np.array(perpendiculars(nominal)) @ direction

    def _slopes(self, axis):
        """Return by how much the mirror's point moves over an axis's travel, before any frame."""
        cell, ends = self.machine.cell, np.tile(np.asarray(self.volume.origin), (2, 1))
        ends[1, axis] += self.machine.travel[axis]
        points, _ = tool_point(ends, cell.errors, cell.chain, np.asarray(cell.mirror_offset))
        return (points[1] - points[0] - ends[1] + ends[0]) / self.machine.travel[axis]

    def _slope(self, name):
        return self.curves[name][-1] / self.machine.travel[moving_axis(name)]


def draw(seed, without=()):
    """Draw a machine.

    Args:
        seed: everything random comes from it.
        without: of ``PARTS``, and names of rotations.
    """
    rng = np.random.default_rng([seed, 1])
    longest = float(np.exp(rng.uniform(*np.log(TRAVEL))))
    travel = longest * rng.uniform(0.5, 1.0, 3)
    travel[rng.integers(3)] = longest
    travel = np.round(travel, 3)
    origin = np.round(rng.uniform(-0.5, 0.5, 3), 3)
    ways = [np.linspace(0.0, length, round(length / _FINE) + 1) for length in travel]
    curves = {
        name: _curve(name, rng, ways[moving_axis(name)], without)
        for name in (*TRANSLATIONS, *ROTATIONS)
    }
    for factor, pair in SQUARENESS_SLOPES.values():
        curve = pair[int(rng.integers(2))]
        angle = SQUARENESS_SIZE * rng.standard_normal()
        curves[curve] = curves[curve] + factor * angle * ways[moving_axis(curve)]
    nodes = [start + way for start, way in zip(origin, ways, strict=True)]
    cell = SimulatedCell(
        name=f"machine {seed}",
        chain=str(rng.choice(CHAINS)),
        errors=ErrorCurves.from_curves(nodes, curves),
        seed=seed,
        misalignment=Misalignment(beam_sigma=BEAM, mirror_sigma=MIRROR),
        dead_path=DEAD_PATH,
        mirror_offset=tuple(rng.uniform(-0.05, 0.05, 3)),
        reading_noise=NOISE,
    )
    wander, told = float(rng.uniform(*WANDER)), bool(rng.random() < 0.5)
    return PlausibleMachine(
        seed,
        cell,
        tuple(map(float, origin)),
        tuple(map(float, travel)),
        wander,
        told,
        tuple(without),
    )


def _zeroed(lines):
    zeros, made = {}, []
    for line in lines:
        zero = zeros.setdefault(line.setup, line.displacement[0])
        made.append(replace(line, displacement=line.displacement - zero))
    return tuple(made)
