"""How the lines of a recorded run were measured on the fly: delays, vibration, time."""

from dataclasses import dataclass
from math import nan

import numpy as np

from stepdiag_ros.bags.run import RecordedRun
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.on_the_fly.flight import FlownLine
from stepdiag_ros.metrology.on_the_fly.record import AxisDelay, Vibration


@dataclass(frozen=True)
class FlownRun:
    """What the lines of a run on the fly have in common.

    Attributes:
        lines: every attempt, in order of time.
        delays: weighted means over the lines; their uncertainty is not below the scatter.
        vibration: mean over the lines that show one.
        common: largest part of a node's standard uncertainty that is common to its line, m.
        seconds: from first to last stop of all lines together.
    """

    lines: tuple[FlownLine, ...]
    delays: tuple[AxisDelay, ...]
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


def _mean_vibration(vibrations: list[Vibration]) -> Vibration:
    if not vibrations:
        return Vibration()
    frequency = float(np.median([one.frequency for one in vibrations]))
    amplitude = float(np.mean([one.amplitude for one in vibrations]))
    spread = [one.standard_uncertainty for one in vibrations]
    count = len(vibrations)
    return Vibration(frequency, amplitude, float(np.linalg.norm(spread)) / count if count else nan)
