"""A machine that moves through a line without stops, read by a laser, with every error at once."""

from dataclasses import dataclass, replace
from math import pi

import numpy as np
from cells_for_tests import make_cell

from stepdiag_ros.metrology.cell import DriveModel
from stepdiag_ros.metrology.drive import AxisMotion, Trajectory
from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.on_the_fly.evaluate import evaluate_pass
from stepdiag_ros.metrology.on_the_fly.record import PassRecord
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD, STEP_DIAGONAL, Line, Volume
from stepdiag_ros.metrology.window import standard_uncertainty_of_mean

START = 1_700_000_000_000_000_000
VOLUME = Volume((0.0, 0.0, 0.0), (0.01, 0.012, 0.008), 6)
DIAGONAL = Line(STEP_DIAGONAL, "ppp", "XYZ", 0, FORWARD)
DRIVE = DriveModel(
    lag_s=0.01, settling_amplitude_m=2e-6, settling_time_s=0.02, settling_frequency_hz=25.0
)


@dataclass(frozen=True)
class Worst:
    """Every error of the worst plausible machine; delays in s, lengths in m."""

    noise: float = 0.1e-6
    jitter: float = 20e-6
    vibration: float = 0.3e-6
    vibration_frequency: float = 40.0
    delay: float = 3.1e-3
    encoder_lags: tuple[float, float, float] = (0.0, 150e-6, -80e-6)
    drift: float = 5e-9
    wander: float = 10e-9
    rotation: float = 10e-6
    feed: float = 0.033
    position_rate: float = 1000.0
    reading_rate: float = 1000.0


class MovingMachine:
    """One pass: where the axes are at each time, and what the laser reads."""

    def __init__(self, seed, line=DIAGONAL, worst=None, volume=VOLUME, blend=None, override=None):
        self.worst = worst = worst or Worst()
        self.rng = rng = np.random.default_rng(seed)
        self.cell = make_cell(
            seed=seed, high=(0.06, 0.072, 0.048), rotation=worst.rotation, tilt=300e-6, mirror=50e-6
        )
        self.line, self.volume = line, volume
        self.targets = line.stops(volume)
        self.direction = beam_direction(line.name, np.asarray(volume.step))
        start = self.targets[0]
        self.alignment = self.cell.alignment("s", line.name, volume.step, start)
        self.motions = []  # (begin, axis, motion, from)
        at = 0.5  # the axes stand from 0.1 s on, as far as the laser knows
        self.node_times = [0.3]
        for number, (one, other) in enumerate(
            zip(self.targets[:-1], self.targets[1:], strict=True)
        ):
            axis = int(np.argmax(np.abs(other - one)))
            feed = worst.feed * (override or {}).get(number + 1, 1.0)
            path = Trajectory.trapezoid(float(one[axis]), float(other[axis]), feed, 2.0)
            motion = AxisMotion(path, DRIVE)
            self.motions.append((at, axis, motion))
            if blend is not None and number + 1 in blend:
                at += path.duration - 0.004
            else:
                at += motion.time_within(0.5e-6) + 0.02 + rng.uniform(0.002, 0.008)
            self.node_times.append(at - 0.005)
        self.end = at + 0.4
        self.node_times[-1] = at + 0.14
        self.wander_at = np.cumsum(
            rng.normal(0.0, worst.wander * np.sqrt(0.1), int(self.end * 10) + 20)
        )
        self.phase = rng.uniform(0.0, 2.0 * pi)

    def places(self, times, lags=(0.0, 0.0, 0.0)):
        places = np.tile(self.targets[0], (len(times), 1))
        for begin, axis, motion in self.motions:
            since = times - lags[axis] - begin
            moved = since > 0.0
            places[moved, axis] = motion.position(since[moved])
        return places

    def slow(self, times):
        steps = np.arange(len(self.wander_at)) * 0.1
        return self.worst.drift * times + np.interp(times, steps, self.wander_at)

    def true(self):
        return self.cell.displacement(self.targets, self.alignment) + self.slow(
            np.array(self.node_times)
        )

    def read(self, times):
        worst, rng = self.worst, self.rng
        really = times + worst.jitter * rng.standard_normal(len(times))
        places = self.places(really)
        vibration = worst.vibration * np.sin(
            2.0 * pi * worst.vibration_frequency * really + self.phase
        )
        return (
            self.cell.displacement(places, self.alignment)
            + self.slow(times)
            + vibration
            + worst.noise * rng.standard_normal(len(times))
        )

    def record(self):
        worst = self.worst
        at = np.arange(0.0, self.end, 1.0 / worst.position_rate)
        times = np.arange(0.1, self.end - 0.1, 1.0 / worst.reading_rate)
        stamped = START + np.round((times + worst.delay) * 1e9).astype(np.int64)
        return PassRecord(
            targets=self.targets,
            direction=self.direction,
            position_times=START + np.round(at * 1e9).astype(np.int64),
            positions=self.places(at, worst.encoder_lags),
            reading_times=stamped,
            sequences=np.arange(len(times), dtype=np.int64) + 7,
            displacements=self.read(times),
            statuses=np.zeros(len(times), dtype=np.uint8),
        )

    def stops(self, rate=100.0, window=0.3):
        """Return the same nodes measured at stops, and their standard uncertainty."""
        values, uncertainties = [], []
        for target, at in zip(self.targets, self.node_times, strict=True):
            times = at + np.arange(round(rate * window)) / rate
            vibration = self.worst.vibration * np.sin(
                2.0 * pi * self.worst.vibration_frequency * times + self.rng.uniform(0.0, 2.0 * pi)
            )
            noise = self.worst.noise * self.rng.standard_normal(len(times))
            read = self.cell.displacement(target[np.newaxis], self.alignment)[0] + self.slow(
                np.array([at])
            )
            values.append(float(np.mean(read + vibration + noise)))
            uncertainties.append(standard_uncertainty_of_mean(read + vibration + noise))
        return np.array(values), np.array(uncertainties)


LINES = (DIAGONAL, replace(DIAGONAL, name="pnp", order="YZX", direction=BACKWARD))
FAST = Worst(feed=0.1)


def differences(values, covariance):
    """Return what the nodes differ by from the first, and the standard uncertainty of that."""
    own = np.diagonal(covariance)
    return values[1:] - values[0], np.sqrt(own[1:] + own[0] - 2.0 * covariance[0, 1:])


def judged(machines):
    """Return node errors, E_n against stops, delay errors and curve errors, as parts of u (E_n)."""
    nodes, e_n, delays, curves = [], [], [], []
    for seed in range(machines):
        worst = (Worst(), FAST)[seed % 2]
        machine = MovingMachine(seed, LINES[seed // 2 % 2], worst)
        record = machine.record()
        found = evaluate_pass(record)
        if any(found.reasons):
            raise AssertionError(found.reasons)
        moved, u = differences(found.displacement, found.covariance)
        true = machine.true()
        nodes.extend((moved - (true[1:] - true[0])) / u)
        nodes.extend(_block_errors(found, true))
        stops, of_stops = machine.stops()
        of_stops = np.sqrt(of_stops[1:] ** 2 + of_stops[0] ** 2)
        e_n.extend((moved - (stops[1:] - stops[0])) / (2.0 * np.sqrt(u**2 + of_stops**2)))
        for axis in found.delays:
            lag = worst.encoder_lags["XYZ".index(axis.axis)]
            delays.append((axis.delay - worst.delay + lag) / axis.standard_uncertainty)
        curves.extend(_curve_errors(machine, record, found))
    return tuple(np.abs(values) for values in (nodes, e_n, delays, curves))


def _block_errors(found, true):
    own, neighbours = np.diagonal(found.covariance), np.diagonal(found.covariance, 1)
    return np.diff(found.displacement - true) / np.sqrt(own[1:] + own[:-1] - 2.0 * neighbours)


def _curve_errors(machine, record, found):
    part = np.linspace(0.1, 0.9, 5)
    for curve in found.curves:
        begin, end = machine.targets[curve.move - 1 : curve.move + 1]
        places = begin + np.outer(part, end - begin)
        slow = machine.slow(np.array(machine.node_times[curve.move - 1 : curve.move + 1]))
        true = machine.cell.displacement(places, machine.alignment)
        true += (1.0 - part) * slow[0] + part * slow[1]
        true -= record.displacements[0] + (places - machine.targets[0]) @ machine.direction
        values, u = curve.at(part)
        yield from (values - true) / u
