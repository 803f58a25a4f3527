"""How the lines of a recorded run were measured on the fly: delays, vibration, time."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import nan

import numpy as np

from stepdiag_ros.bags.run import RecordedRun
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.on_the_fly.flight import FlownLine
from stepdiag_ros.metrology.on_the_fly.record import AxisDelay, Vibration
from stepdiag_ros.metrology.plan import Volume


@dataclass(frozen=True)
class FlownRun:
    """What the lines of a run on the fly have in common.

    Attributes:
        lines: every attempt, in order of time.
        delays: weighted means over the lines; their uncertainty is not below the scatter.
        reversals: of each axis that moved in both directions, the delay in its positive sense less
            that in its negative one. A force that bends the machine while it moves changes its sign
            with the motion and looks like a delay, whereas clocks, filters and encoders do not.
        vibration: mean over the lines that show one.
        common: largest part of a node's standard uncertainty that is common to its line, m.
        seconds: from first to last stop of all lines together.
    """

    lines: tuple[FlownLine, ...]
    delays: tuple[AxisDelay, ...]
    reversals: tuple[AxisDelay, ...]
    vibration: Vibration
    common: float
    seconds: float


def flown_run(recorded: RecordedRun) -> FlownRun | None:
    """Return how the lines of a run were measured on the fly; None where none was.

    Raises:
        BagError: the bag has changed or gone since it was loaded.
    """
    lines: list[FlownLine] = []
    if recorded.plan.on_the_fly:
        assemble(
            recorded.plan,
            recorded.start_time,
            recorded.commands,
            recorded.arrivals,
            recorded.readings(),
            recorded.positions(),
            lines.append,
        )
    good = [line.found for line in lines if line.found.delays]
    if not good:
        return None
    axes = sorted({delay.axis for found in good for delay in found.delays})
    found_vibrations = [found.vibration for found in good if found.vibration.found]
    return FlownRun(
        lines=tuple(lines),
        delays=tuple(
            _mean_delay([delay for found in good for delay in found.delays if delay.axis == axis])
            for axis in axes
        ),
        reversals=reversals_of(lines, recorded.plan.volume),
        vibration=_mean_vibration(found_vibrations),
        common=max(found.common for found in good),
        seconds=sum(line.seconds for line in lines),
    )


def _mean_delay(delays: list[AxisDelay]) -> AxisDelay:
    values = np.array([delay.delay for delay in delays])
    weights = np.array([delay.standard_uncertainty for delay in delays]) ** -2.0
    mean = float(np.sum(weights * values) / np.sum(weights))
    variance = 1.0 / float(np.sum(weights))
    if len(delays) > 1:
        birge = float(np.sum(weights * (values - mean) ** 2)) / (len(delays) - 1)
        variance *= max(1.0, birge)
    return AxisDelay(delays[0].axis, mean, float(np.sqrt(variance)))


def reversals_of(lines: Iterable[FlownLine], volume: Volume) -> tuple[AxisDelay, ...]:
    """Return the delay of each axis in positive motion less that in negative motion.

    Axes that moved in one direction alone are left out.

    Args:
        lines: of a run.
        volume: its box.
    """
    found: dict[str, dict[bool, list[AxisDelay]]] = {}
    for line in lines:
        stops = line.line.stops(volume)
        for delay in line.found.delays:
            positive = bool((stops[-1] - stops[0])[AXES.index(delay.axis[0])] > 0.0)
            found.setdefault(delay.axis, {True: [], False: []})[positive].append(delay)
    made = []
    for axis, senses in sorted(found.items()):
        if senses[True] and senses[False]:
            up, down = _mean_delay(senses[True]), _mean_delay(senses[False])
            spread = float(np.hypot(up.standard_uncertainty, down.standard_uncertainty))
            made.append(AxisDelay(axis, up.delay - down.delay, spread))
    return tuple(made)


def _mean_vibration(vibrations: list[Vibration]) -> Vibration:
    if not vibrations:
        return Vibration()
    frequency = float(np.median([one.frequency for one in vibrations]))
    amplitude = float(np.mean([one.amplitude for one in vibrations]))
    spread = [one.standard_uncertainty for one in vibrations]
    count = len(vibrations)
    return Vibration(frequency, amplitude, float(np.linalg.norm(spread)) / count if count else nan)
