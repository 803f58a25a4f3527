"""True state of a simulated cell: machine errors, misalignment, noise, weather and drive behaviour.

The simulated devices run on it, and so does the stop-level simulation; nothing that estimates may
see it.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.description import active_effect
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.forward import (
    SQUARENESS_SLOPES,
    Alignment,
    ErrorCurves,
    in_result_frame,
    reading,
    rotation_vectors,
    tilted,
    tool_point,
)
from stepdiag_ros.metrology.geometry import (
    AXES,
    CHAINS,
    ROTATIONS,
    SQUARENESS,
    TRANSLATIONS,
    Vector,
    beam_direction,
    line_signs,
)
from stepdiag_ros.metrology.measurement import Environment
from stepdiag_ros.metrology.plan import Plan, Volume
from stepdiag_ros.metrology.refusal import Refusal, fields_of
from stepdiag_ros.metrology.tracker.lengths import machine_lengths

_WAVES = 3
_FINE_NODES = 241
_STATION_SCATTER = 1e-3


@dataclass(frozen=True)
class DriveModel:
    """How a servo axis follows its command, and how it comes to rest.

    Attributes:
        lag_s: time constant of the first-order lag behind the command, s.
        settling_amplitude_m: amplitude of the vibration at the end of a move, m.
        settling_time_s: time constant of its decay, s.
        settling_frequency_hz: of that vibration, Hz.
    """

    lag_s: float = 0.01
    settling_amplitude_m: float = 0.0
    settling_time_s: float = 0.02
    settling_frequency_hz: float = 25.0


@dataclass(frozen=True)
class WeatherModel:
    """Air and material as functions of time: a value, a steady drift and one slow wave.

    The material may warm up besides, towards a limit, as a machine does that has been switched on.
    It affects nothing but its own reading: a simulated machine grows only by an effect.

    Attributes:
        air_temperature: at time 0, degC.
        air_temperature_drift: K/s.
        air_temperature_wave: amplitude, K.
        wave_period: of air and material, s.
        air_pressure: at time 0, Pa.
        air_pressure_drift: Pa/s.
        relative_humidity: 0..1.
        material_temperature: at time 0, degC.
        material_temperature_drift: K/s.
        material_temperature_wave: amplitude, K; an eighth of a period behind that of the air.
        material_warm_up: in the end, K.
        warm_up_time: time constant of it, s.
    """

    air_temperature: float = 20.0
    air_temperature_drift: float = 0.0
    air_temperature_wave: float = 0.0
    wave_period: float = 1800.0
    air_pressure: float = 101325.0
    air_pressure_drift: float = 0.0
    relative_humidity: float = 0.5
    material_temperature: float = 20.0
    material_temperature_drift: float = 0.0
    material_temperature_wave: float = 0.0
    material_warm_up: float = 0.0
    warm_up_time: float = 1800.0

    def at(self, time_s: float) -> Environment:
        """Return the weather at a time since the cell's start, s."""
        warm = -self.material_warm_up * np.expm1(-max(time_s, 0.0) / self.warm_up_time)
        phase = 2.0 * np.pi * time_s / self.wave_period
        wave = self.air_temperature_wave * np.sin(phase)
        # A mass follows its air late.
        slow = self.material_temperature_wave * np.sin(phase - 0.25 * np.pi)
        return Environment(
            self.air_temperature + self.air_temperature_drift * time_s + float(wave),
            self.air_pressure + self.air_pressure_drift * time_s,
            self.relative_humidity,
            self.material_temperature
            + self.material_temperature_drift * time_s
            + float(warm + slow),
        )


@dataclass(frozen=True)
class Misalignment:
    """How far beam and mirror of each setup are off.

    A beam tilt is two angles: components of the beam's direction along ``forward.perpendiculars``
    of the nominal one. A mirror is set to return the beam, so its own two angles are counted from
    the beam.

    Attributes:
        beam_sigma: standard deviation of each angle of the beam, rad.
        mirror_sigma: standard deviation of each angle of the mirror's normal from the beam, rad.
        explicit: setup or line → beam angle 1, 2 and mirror angle 1, 2, rad, in place of random
            ones.
    """

    beam_sigma: float = 0.0
    mirror_sigma: float = 0.0
    explicit: Mapping[str, tuple[float, float, float, float]] = field(default_factory=dict)

    def angles(self, setup: str, line: str, seed: int) -> tuple[float, float, float, float]:
        """Return the four angles of a setup, the same in every process, rad."""
        for name in (setup, line):
            if name in self.explicit:
                return self.explicit[name]
        rng = np.random.default_rng([seed, *_stable_numbers(setup)])
        beam_1, beam_2, mirror_1, mirror_2 = (float(value) for value in rng.standard_normal(4))
        return (
            self.beam_sigma * beam_1,
            self.beam_sigma * beam_2,
            self.mirror_sigma * mirror_1,
            self.mirror_sigma * mirror_2,
        )


@dataclass(frozen=True)
class SimulatedCell:
    """Everything that is true of a simulated cell.

    Attributes:
        name: in words.
        chain: order of the axes from workpiece to tool.
        errors: true error motions.
        seed: of everything random in the cell.
        misalignment: of beam and mirror.
        dead_path: from the laser's reference to the mirror at the first stop of a line, m.
        mirror_offset: of the mirror from the tool point, m.
        reading_noise: standard deviation of one reading, m.
        reading_rate: that the simulated interferometer has if nothing else is asked for, Hz.
        weather: air and material over time.
        drive: of all axes.
        vibration: amplitude with which the mirror vibrates against the laser along the beam, m.
        vibration_frequency: Hz.
        stamp_jitter: standard deviation of the time at which a reading is really taken, s.
        effects: of the catalogue that act beyond the error motions, on the readings at stops
            (``simulation``, ``live_effects``); they are not part of ``truth``.
    """

    name: str
    chain: str
    errors: ErrorCurves
    seed: int = 0
    misalignment: Misalignment = field(default_factory=Misalignment)
    dead_path: float = 0.3
    mirror_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    reading_noise: float = 0.1e-6
    reading_rate: float = 100.0
    weather: WeatherModel = field(default_factory=WeatherModel)
    drive: DriveModel = field(default_factory=DriveModel)
    vibration: float = 0.0
    vibration_frequency: float = 40.0
    stamp_jitter: float = 0.0
    effects: tuple[ActiveEffect, ...] = ()

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], source: str) -> "SimulatedCell":
        """Make a cell from the parsed YAML of a cell file (layout in ``config/cells``).

        Raises:
            ValueError: names the source, the key, what is wrong and what is expected.
        """
        section = Section(mapping, source)
        seed = section.integer("seed", low=0, high=2**63 - 1, default=0)
        cell = cls(
            name=section.text("name", default="unnamed"),
            chain=section.names("chain", CHAINS)[0],
            errors=_errors(section.section("errors"), f"{source}: errors", seed),
            seed=seed,
            misalignment=_misalignment(section.section("misalignment"), f"{source}: misalignment"),
            dead_path=section.number("dead_path_m", low=0.0, high=100.0, default=cls.dead_path),
            mirror_offset=section.vector("mirror_offset_m", default=cls.mirror_offset),
            reading_noise=section.number(
                "reading_noise_m", low=0.0, high=1e-3, default=cls.reading_noise
            ),
            reading_rate=section.number(
                "reading_rate_hz", low=0.1, high=1e4, default=cls.reading_rate
            ),
            weather=_weather(section.section("weather")),
            drive=_drive(section.section("drive")),
            vibration=section.number("vibration_m", low=0.0, high=1e-3, default=cls.vibration),
            vibration_frequency=section.number(
                "vibration_hz", low=0.1, high=1e4, default=cls.vibration_frequency
            ),
            stamp_jitter=section.number(
                "stamp_jitter_s", low=0.0, high=1e-3, default=cls.stamp_jitter
            ),
            effects=_effects(section, mapping),
        )
        section.finish()
        return cell

    def alignment(
        self,
        setup: str,
        line: str,
        step: Sequence[float],
        start: Sequence[float] = (0.0, 0.0, 0.0),
        mount: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> Alignment:
        """Return how beam and mirror really stand in a setup.

        Args:
            setup: identity of the setup; the same setup has the same misalignment in every process.
            line: name of the line.
            step: size of one block along X, Y, Z, m.
            start: machine coordinates of the line's first stop, m: the laser stands the dead path
                away from it. It moves a reading's zero, and a real effect only where the machine
                turns.
            mount: of the mirror from its usual place on the tool (``Line.mirror_offset``), m.
        """
        beam_1, beam_2, mirror_1, mirror_2 = self.misalignment.angles(setup, line, self.seed)
        nominal = beam_direction(line, np.asarray(step, dtype=np.float64))
        beam = tilted(nominal, (beam_1, beam_2))
        normal = tilted(nominal, (beam_1 + mirror_1, beam_2 + mirror_2))
        mirror = np.asarray(self.mirror_offset) + np.asarray(mount)
        first_point = np.asarray(start, dtype=np.float64) + mirror
        return Alignment(beam, normal, first_point - self.dead_path * beam)

    def require(self, positions: Vector, what: str) -> None:
        """Refuse places where the machine's errors are not given.

        Args:
            positions: that are to be measured, machine coordinates, m, shape (n, 3).
            what: has them, in words, as the sentence begins.

        Raises:
            ValueError: one is outside of the curves.
        """
        if beyond := self.errors.outside(positions):
            raise Refusal(
                f"{what}: {beyond} in the cell '{self.name}'. Measure within this range, or give"
                " the cell a larger one (travel_low_m and travel_high_m, or nodes_m): see"
                " 'Your own machine, simulated' in docs/planning.md",
                fault="out_of_range",
            )

    def require_stops(self, plan: Plan) -> None:
        """Refuse a plan with a stop where the machine's errors are not given; see ``require``."""
        for line in plan.lines:
            self.require(line.stops(plan.volume), f"line {line.name} of plan '{plan.name}'")

    def displacement(
        self, positions: Vector, alignment: Alignment, mount: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> Vector:
        """Return the true displacement of the mirror along the beam, without noise, m, shape (n,).

        Args:
            positions: actual positions of the axes, machine coordinates, m, shape (n, 3).
            alignment: of the line; its zero (the laser's reference) is arbitrary.
            mount: of the mirror from its usual place on the tool (``Line.mirror_offset``), m.
        """
        place = np.asarray(self.mirror_offset) + np.asarray(mount)
        offset = place if np.any(place) else None
        return reading(positions, alignment, self.errors, self.chain, offset)

    def station(self, setup: str, planned: Sequence[float]) -> Vector:
        """Return where a tracker really stands, machine coordinates, m, shape (3,).

        Nobody puts it up better than to about a millimetre.

        Args:
            setup: identity of the zero; a new zero (`` #2``) leaves the tracker where it is.
            planned: place of the tracker by the plan, m.
        """
        rng = np.random.default_rng([self.seed, *_stable_numbers(setup.partition(" #")[0])])
        place: Vector = np.asarray(planned) + _STATION_SCATTER * rng.standard_normal(3)
        return place

    def length(self, positions: Vector, station: Vector) -> Vector:
        """Return the true lengths from a tracker to the reflector, without noise, m, shape (n,).

        Args:
            positions: actual positions of the axes, machine coordinates, m, shape (n, 3).
            station: of the tracker, see ``metrology.tracker``, m, shape (3,).
        """
        offset = np.asarray(self.mirror_offset) if any(self.mirror_offset) else None
        return machine_lengths(positions, station, self.errors, self.chain, offset)

    def environment(self, time_s: float) -> Environment:
        """Return air and material at a time since the cell's start, s."""
        return self.weather.at(time_s)

    def truth(self, volume: Volume) -> dict[str, Vector]:
        """Return all eighteen true curves at the reference point, in the frame of the results.

        Each has its values at the volume's nodes, shape (N + 1,), m or rad, and begins at zero.
        They are what the mirror's point and the tool really do as one axis moves with the others at
        the volume's first corner (``geometry.REFERENCE_POINT``), exactly; the frame is
        ``geometry.FRAME``.

        Raises:
            ValueError: the volume is larger than the travel of which errors are given.
        """
        nodes = volume.all_nodes
        ends = np.array([[axis_nodes[0], axis_nodes[-1]] for axis_nodes in nodes]).T
        self.require(ends, "the true errors of the measured box")
        offset = np.asarray(self.mirror_offset)
        curves: dict[str, Vector] = {}
        for axis, letter in enumerate(AXES):
            positions = np.tile(np.asarray(volume.origin, dtype=np.float64), (len(nodes[axis]), 1))
            positions[:, axis] = nodes[axis]
            point, rotation = tool_point(positions, self.errors, self.chain, offset)
            if rotation is None:
                # The same, without the rounding of a difference of positions.
                moved = self.errors.at(axis, nodes[axis])[:, :3]
                turned = np.zeros_like(moved)
            else:
                moved = point - point[0] - (positions - positions[0])
                turned = rotation_vectors(rotation @ rotation[0].T)
            for column in range(3):
                curves[f"E_{AXES[column]}{letter}"] = moved[:, column]
                curves[f"E_{'ABC'[column]}{letter}"] = turned[:, column]
        framed = in_result_frame(nodes, curves)
        return {**framed, **{name: curves[name] for name in ROTATIONS}}


def _stable_numbers(text: str) -> list[int]:
    """Return four integers from a text alone; Python's hash() differs between processes."""
    digest = hashlib.sha256(text.encode()).digest()
    return [int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4)]


def _misalignment(section: Section, source: str) -> Misalignment:
    explicit_section = section.section("lines")
    explicit = {}
    for name in explicit_section.keys():  # noqa: SIM118
        words = name.split()
        if not words:
            raise ValueError(f"{source}: lines: an empty name is not a line")
        line_signs(words[0].split("@")[0])
        one, two, three, four = explicit_section.numbers(name, count=4)
        explicit[name] = (one, two, three, four)
    explicit_section.finish()
    made = Misalignment(
        beam_sigma=section.number("beam_sigma_rad", low=0.0, high=0.1, default=0.0),
        mirror_sigma=section.number("mirror_sigma_rad", low=0.0, high=0.1, default=0.0),
        explicit=explicit,
    )
    section.finish()
    return made


def _weather(section: Section) -> WeatherModel:
    standard = WeatherModel()
    made = WeatherModel(
        air_temperature=section.number(
            "air_temperature_degC", low=-50, high=100, default=standard.air_temperature
        ),
        air_temperature_drift=section.number("air_temperature_drift_K_per_h", default=0.0) / 3600,
        air_temperature_wave=section.number("air_temperature_wave_K", default=0.0),
        wave_period=section.number("wave_period_s", low=1.0, default=standard.wave_period),
        air_pressure=section.number(
            "air_pressure_Pa", low=3e4, high=2e5, default=standard.air_pressure
        ),
        air_pressure_drift=section.number("air_pressure_drift_Pa_per_h", default=0.0) / 3600,
        relative_humidity=section.number(
            "relative_humidity", low=0.0, high=1.0, default=standard.relative_humidity
        ),
        material_temperature=section.number(
            "material_temperature_degC", low=-50, high=100, default=standard.material_temperature
        ),
        material_temperature_drift=section.number("material_temperature_drift_K_per_h", default=0.0)
        / 3600,
        material_temperature_wave=section.number("material_temperature_wave_K", default=0.0),
        material_warm_up=section.number("material_warm_up_K", low=-50, high=50, default=0.0),
        warm_up_time=section.number("warm_up_time_s", low=1.0, default=standard.warm_up_time),
    )
    section.finish()
    return made


def _drive(section: Section) -> DriveModel:
    standard = DriveModel()
    made = DriveModel(
        lag_s=section.number("lag_s", low=0.0, high=10.0, default=standard.lag_s),
        settling_amplitude_m=section.number(
            "settling_amplitude_m", low=0.0, high=1e-2, default=standard.settling_amplitude_m
        ),
        settling_time_s=section.number(
            "settling_time_s", low=1e-4, high=60.0, default=standard.settling_time_s
        ),
        settling_frequency_hz=section.number(
            "settling_frequency_hz", low=0.0, high=1e4, default=standard.settling_frequency_hz
        ),
    )
    section.finish()
    return made


def _effects(section: Section, mapping: Mapping[str, Any]) -> tuple[ActiveEffect, ...]:
    if mapping.get("effects", []) == []:
        section.unknown("effects")
        return ()
    known = catalogue()
    made = []
    for part in section.sections("effects"):
        active = active_effect(part, known)
        part.finish()
        if active.effect.typical:
            raise Refusal(
                f"{part.source}: '{active.effect.name}' is only the typical size of unknown errors,"
                " which cannot be simulated; give the errors themselves under errors (curves E_AX"
                " to E_CZ, or rotation_rad)",
                fault="unsupported",
            )
        _require_plausible(active, part.source)
        made.append(active)
    return tuple(made)


def _require_plausible(active: ActiveEffect, source: str) -> None:
    """Refuse a size that no machine has: a run with it may not even be measurable."""
    for size in active.effect.sizes:
        value = active.sizes[size.name]
        if not size.low <= value <= size.high:
            unit = "" if size.unit == "1" else f" {size.unit}"
            raise Refusal(
                f"{source}: '{size.name}' of '{active.effect.name}' is {value:g}{unit}; its"
                f" plausible sizes are {size.low:g} to {size.high:g}{unit}",
                fault="out_of_range",
                about=size.name,
                where=source,
            )


def _errors(section: Section, source: str, seed: int) -> ErrorCurves:
    """Read error motions: values at nodes, or seeded smooth curves; squareness on top of either."""
    given = "curves" in section.keys()  # noqa: SIM118
    made = _given_errors(section, source) if given else _generated_errors(section, source, seed)
    squareness = section.section("squareness_rad")
    for name in SQUARENESS:
        angle = squareness.number(name, low=-0.1, high=0.1, default=0.0)
        factor, (first, second) = SQUARENESS_SLOPES[name]
        # The turn is put wholly on the curve that the frame of the results leaves free.
        curve = second if name == "A0Z" else first
        axis, error = AXES.index(curve[3]), AXES.index(curve[2])
        way = made.nodes[axis] - made.nodes[axis][0]
        made.values[axis][:, error] += factor * angle * way
    squareness.finish()
    section.finish()
    return made


def _given_errors(section: Section, source: str) -> ErrorCurves:
    nodes_section = section.section("nodes_m")
    nodes = [np.array(nodes_section.numbers(axis)) for axis in AXES]
    nodes_section.finish()
    curves_section = section.section("curves")
    names = curves_section.keys()
    curves = {name: np.array(curves_section.numbers(name)) for name in names}
    curves_section.finish()
    try:
        return ErrorCurves.from_curves(nodes, curves)
    except ValueError as error:
        raise Refusal(f"{source}: {error}", **fields_of(error)) from None


def _generated_errors(section: Section, source: str, seed: int) -> ErrorCurves:
    """Make smooth curves.

    E(u) = size · (slope·u + Σ_w g_w/w · (sin(2πwu + φ_w) - sin φ_w)) with u = 0..1 over the travel.

    With g_w and the slope standard normal and φ_w uniform, w = 1..3, from the seed and the curve's
    name; straightness curves have no slope of their own (that is squareness).
    """
    low = np.array(section.vector("travel_low_m"))
    high = np.array(section.vector("travel_high_m"))
    sizes = {
        "positioning": section.number("positioning_m", low=0.0, high=1e-2, default=0.0),
        "straightness": section.number("straightness_m", low=0.0, high=1e-2, default=0.0),
        "rotation": section.number("rotation_rad", low=0.0, high=1e-2, default=0.0),
    }
    if np.any(low >= high):
        raise Refusal(
            f"{source}: travel_low_m is not below travel_high_m", fault="mismatch", aspect="travel"
        )
    share = np.linspace(0.0, 1.0, _FINE_NODES)
    curves: dict[str, Vector] = {}
    for name in (*TRANSLATIONS, *ROTATIONS):
        rng = np.random.default_rng([seed, *_stable_numbers(name)])
        slope = rng.standard_normal()
        sizes_of_waves = rng.standard_normal(_WAVES)
        phases = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
        kind = "rotation" if name in ROTATIONS else "straightness"
        if name[2] == name[3]:
            kind = "positioning"
        curve = np.zeros(_FINE_NODES) if kind == "straightness" else slope * share
        for wave in range(1, _WAVES + 1):
            phase = phases[wave - 1]
            curve += (
                sizes_of_waves[wave - 1]
                / wave
                * (np.sin(2.0 * np.pi * wave * share + phase) - np.sin(phase))
            )
        curves[name] = sizes[kind] * curve
    nodes = [np.linspace(low[axis], high[axis], _FINE_NODES) for axis in range(3)]
    return ErrorCurves.from_curves(nodes, curves)
