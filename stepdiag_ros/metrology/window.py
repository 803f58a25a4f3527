"""A window of readings at a stop: its mean, how sure that is, and whether the stop was at rest."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isinf, isnan, sqrt

import numpy as np

from stepdiag_ros.metrology.geometry import Vector, inner
from stepdiag_ros.metrology.measurement import Environment, Reading
from stepdiag_ros.metrology.plan import Sampling

FEWEST_READINGS = 3
"""With fewer, neither a standard deviation nor a slope means anything."""

STATUS_WORDS = {
    1: "the signal was low",
    2: "the beam was lost",
    3: "the mirror moved too fast for the counter",
    4: "the interferometer reported a fault",
    5: "the count did not fit the way of the axes",
}
"""What STATUS_* of InterferometerReading.msg mean, other than 0 (good)."""

_UNKNOWN = float("nan")


@dataclass(frozen=True)
class Window:
    """What the readings of one window say.

    Attributes:
        start: ns, belongs to the window.
        end: ns, does not belong to it.
        time: mean time of the readings, ns; middle of the window if there are none.
        displacement: mean of the compensated readings, m.
        raw_displacement: mean of the raw readings, m.
        standard_deviation: of one compensated reading, m; NaN with fewer than two.
        standard_uncertainty: of the mean, m (``standard_uncertainty_of_mean``).
        drift: slope of the fitted straight line times the length of the window, m.
        readings: how many.
        first_sequence: of the first reading; 0 if there are none.
        last_sequence: of the last reading; 0 if there are none.
        environment: mean of each quantity; NaN where it was unknown at any of the readings.
        fault: why the readings cannot be used, whatever their values; empty if they can.
        trigger: number of the hardware trigger that they were taken at; 0: none.
    """

    start: int
    end: int
    time: int
    displacement: float
    raw_displacement: float
    standard_deviation: float
    standard_uncertainty: float
    drift: float
    readings: int
    first_sequence: int
    last_sequence: int
    environment: Environment
    fault: str
    trigger: int = 0

    def objection(self, sampling: Sampling, last_trigger: int = 0) -> str:
        """Say why the stop cannot count as settled in this window; empty if it can.

        Args:
            sampling: the limits.
            last_trigger: number of the trigger of the stop before; 0: it had none.
        """
        if self.fault:
            return self.fault
        if last_trigger and not self.trigger:
            return f"no trigger has come since trigger {last_trigger}, that of the stop before"
        if last_trigger and self.trigger == last_trigger:
            return f"trigger {last_trigger} was that of the stop before"
        if self.standard_deviation > sampling.standard_deviation_limit:
            limit = _micrometres(sampling.standard_deviation_limit)
            return (
                "the standard deviation of the readings is "
                f"{_micrometres(self.standard_deviation)}, above the limit of {limit}"
            )
        if abs(self.drift) > sampling.drift_limit:
            return (
                f"the readings drift by {_micrometres(self.drift)} in the window, "
                f"above the limit of {_micrometres(sampling.drift_limit)}"
            )
        return ""


def examine(readings: Sequence[Reading], start: int, end: int) -> Window:
    """Return what the readings of the window [start, end) say.

    Where some of them were taken at a hardware trigger, these alone count: the trigger knows better
    when the machine stood than any time stamp. They need not fill the window.

    Args:
        readings: those with a time within the window, in order.
        start: ns.
        end: ns.
    """
    triggered = [reading for reading in readings if reading.trigger]
    readings = triggered or readings
    count = len(readings)
    if count == 0:
        return Window(
            start=start,
            end=end,
            time=(start + end) // 2,
            displacement=_UNKNOWN,
            raw_displacement=_UNKNOWN,
            standard_deviation=_UNKNOWN,
            standard_uncertainty=_UNKNOWN,
            drift=_UNKNOWN,
            readings=0,
            first_sequence=0,
            last_sequence=0,
            environment=Environment(),
            fault="there are no readings in the window",
        )
    values = np.array([reading.compensated_displacement for reading in readings])
    # What is not finite, or beyond all measure, gives no mean; ``_fault`` and the plan say so.
    with np.errstate(invalid="ignore", over="ignore"):
        return _window(readings, values, start, end)


def _window(readings: Sequence[Reading], values: Vector, start: int, end: int) -> Window:
    count = len(readings)
    # Whole nanoseconds since the window's start, so that an epoch of 1e18 ns costs no precision.
    offsets = np.array([reading.time - start for reading in readings], dtype=np.int64)
    seconds = np.asarray(offsets * 1e-9, dtype=np.float64)
    return Window(
        start=start,
        end=end,
        time=start + int(np.sum(offsets)) // count,
        displacement=_mean(values),
        raw_displacement=_mean(np.array([reading.raw_displacement for reading in readings])),
        standard_deviation=float(np.std(values - values[0], ddof=1)) if count > 1 else _UNKNOWN,
        standard_uncertainty=standard_uncertainty_of_mean(values),
        drift=_slope(seconds, values) * (end - start) * 1e-9,
        readings=count,
        first_sequence=readings[0].sequence,
        last_sequence=readings[-1].sequence,
        environment=mean_environment(readings),
        fault=_fault(readings, start, end),
        trigger=readings[-1].trigger,
    )


def standard_uncertainty_of_mean(values: Vector) -> float:
    """Return the standard uncertainty (GUM type A) of the mean of readings taken at even intervals.

    Readings that follow each other closely are not independent (air turbulence, vibration, a
    drift), and s/√n then promises too much. With ρ(i) the autocorrelation at a lag of i readings,

        n_eff = n / [1 + (2/n) · Σ_{i=1..m} (n - i) · ρ(i)],   u² = ((n - 1)/n) · s² / (n_eff - 1)

    (Zhang, Metrologia 43 (2006) S276; Zięba, Metrology and Measurement Systems 17 (2010) 3), summed
    up to the first ρ(i) that is not positive (Zięba & Ramza, the same journal 18 (2011) 529). If
    ρ(1) is within the 95 % interval of independent readings, 1.96/√n, they are taken as independent
    and u = s/√n. It is never taken below s/√n, because readings that seem to alternate
    give no reason to trust their mean more, nor above s: the mean is known no worse than one
        reading.

    Args:
        values: readings, m, shape (n,).

    Returns:
        Standard uncertainty, m; NaN for fewer than two readings or if any is NaN.
    """
    count = len(values)
    if count < 2:
        return _UNKNOWN
    deviations = values - values[0]
    deviations = deviations - np.mean(deviations)
    power = float(inner(deviations, deviations))
    if isnan(power):
        return _UNKNOWN
    if power == 0.0:
        return 0.0
    inflation = 1.0
    for lag in range(1, count - 1):
        correlation = float(inner(deviations[:-lag], deviations[lag:])) / power
        if correlation <= (1.96 / sqrt(count) if lag == 1 else 0.0):
            break
        inflation += 2.0 * (count - lag) / count * correlation
    effective = max(count / inflation, 2.0)
    return sqrt(power / count / (effective - 1.0))


def _fault(readings: Sequence[Reading], start: int, end: int) -> str:
    for reading in readings:
        if reading.status != 0:
            return STATUS_WORDS.get(
                reading.status, f"the interferometer gave the unknown status {reading.status}"
            )
    if any(isinf(reading.compensated_displacement) for reading in readings):
        return "a displacement without end was read: the instrument or its driver is at fault"
    if any(isnan(reading.compensated_displacement) for reading in readings):
        return (
            "the air is not known, so the readings are not compensated: check the weather sensors"
        )
    if len(readings) < FEWEST_READINGS:
        return f"only {len(readings)} readings in the window; at least {FEWEST_READINGS} are needed"
    lost = readings[-1].sequence - readings[0].sequence + 1 - len(readings)
    if lost != 0:
        return f"{lost} readings of the window are missing"
    triggers = sorted({reading.trigger for reading in readings})
    if len(triggers) > 1:
        numbers = ", ".join(map(str, triggers))
        return f"the triggers {numbers} came in one stop: does the trigger line bounce?"
    if triggers[0]:
        return ""
    times = [start, *(reading.time for reading in readings), end]
    longest = max(after - before for before, after in pairwise(times))
    if 2 * longest > end - start:
        return f"the readings pause for {longest * 1e-9:.3g} s and do not fill the window"
    return ""


def _mean(values: Vector) -> float:
    # About the first value: a metre of displacement then costs no digits of a nanometre.
    return float(values[0] + np.mean(values - values[0]))


def _slope(times: Vector, values: Vector) -> float:
    centred = times - float(np.mean(times))
    spread = float(inner(centred, centred))
    return float(inner(centred, values - values[0])) / spread if spread > 0.0 else _UNKNOWN


def mean_environment(readings: Sequence[Reading]) -> Environment:
    """Return the mean of each quantity over some readings; NaN where it was unknown at any."""
    first = readings[0].environment
    if all(reading.environment is first for reading in readings):
        return first
    columns = np.array([reading.environment for reading in readings])
    return Environment(*(_mean(column) for column in columns.T))


def _micrometres(value: float) -> str:
    return f"{value * 1e6:.3g} µm"
