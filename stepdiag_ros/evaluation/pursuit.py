"""Whether a run has reached its target, and how long it takes still: one function of its lines.

Live, the solver calls it after every line; for a bag, the report calls it with the same data
classes, so that a replay decides alike. What is reached is the uncertainty of the results (with
what unseen rotations may do), never one that was computed for the plan. The rest is foretold by the
plan: a perfect machine is solved by the same method over the lines so far and over more of them,
and what is reached changes by the same ratio.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite, nan

import numpy as np

from stepdiag_ros.configuration import machine_from_text, target_from_text
from stepdiag_ros.evaluation.lead import RunLead
from stepdiag_ros.evaluation.solving import one_thread
from stepdiag_ros.metrology.discrepancy.power import power_of
from stepdiag_ros.metrology.geometry import ROTATIONS, SQUARENESS
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.plausible import Plausible
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.solvers.catalogue import in_order_of_reliance, to_rely_on
from stepdiag_ros.metrology.solvers.result import NotDeterminable, VolumetricErrors
from stepdiag_ros.metrology.standards.axis_test import all_runs
from stepdiag_ros.metrology.standards.iso230_2 import evaluate
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.target import (
    VOLUMETRIC,
    Target,
    TargetStanding,
    TargetState,
    lacking_runs,
    line_ends,
)
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.planning.duration import duration
from stepdiag_ros.planning.expectation import nominal_measurement
from stepdiag_ros.text.numbers import in_micro

_LARGE = "U is larger than the target"
ORDINARY_STOP = 0.1e-6
"""Standard uncertainty of a stop before any was read, m: that of ``stepdiag plan``."""


@dataclass(frozen=True)
class Pursuit:
    """A run with a target: what is known of it before its first line.

    Attributes:
        target: to be reached.
        plan: of the run.
        machine: that executes it.
    """

    target: Target
    plan: Plan
    machine: Machine

    @property
    def plausible(self) -> Plausible:
        """Return the plausible size of the machine's rotations."""
        return Plausible(rotation=self.machine.rotations)

    @cached_property
    def line_times(self) -> tuple[float, ...]:
        """Return how long each line takes, without alignments, s."""
        lines = duration(self.plan, self.machine).lines
        return tuple(line.total - line.alignment for line in lines)

    @cached_property
    def line_ends(self) -> tuple[int, ...]:
        """Return after how many lines enough passes are measured to end the run."""
        return line_ends(self.target, self.plan)

    @cached_property
    def _nominal(self) -> Measurement:
        made = nominal_measurement(self.plan, ORDINARY_STOP)
        return replace(made, chain=self.machine.chain, plausible=self.plausible)

    def foretold(self, count: int, stop_uncertainty: float) -> float:
        """Return the expanded uncertainty of a perfect machine's first lines; NaN if unknown.

        Args:
            count: of lines.
            stop_uncertainty: standard uncertainty of a stop, m.
        """
        lines = tuple(
            replace(line, standard_uncertainty=np.full(len(line.time), stop_uncertainty))
            for line in self._nominal.lines[:count]
        )
        measurement = replace(self._nominal, lines=lines)
        method = "rigid_body" if self.target.quantity in ROTATIONS else "least_squares"
        results: dict[str, VolumetricErrors] = {}
        if not self.target.line_and_parameter[0]:
            try:
                results[method] = solve(measurement, method)
            except NotDeterminable:
                return nan
        return _by_results(self.target, measurement, results)


def pursuit_from_text(target: str, plan: Plan, machine: str) -> Pursuit | None:
    """Return the pursuit of a run by its description; None if it has no target.

    Args:
        target: as in RunDescription.
        plan: of the run.
        machine: YAML text of the machine.

    Raises:
        ValueError: target or machine cannot be read.
    """
    if not target:
        return None
    known = machine_from_text(machine, "machine of the run")
    return Pursuit(target_from_text(target, "target of the run"), plan, known)


def reached(
    target: Target,
    measurement: Measurement,
    results: Mapping[str, VolumetricErrors],
    lead: RunLead,
) -> float:
    """Return the expanded uncertainty of a target's quantity; NaN if it is not known.

    Args:
        target: names the quantity.
        measurement: the lines.
        results: of these lines, method → errors.
        lead: what verdict and report state of them.
    """
    found = _by_results(target, measurement, results)
    if target.quantity != VOLUMETRIC or not isfinite(found):
        return found
    # What is stated has the uncertainty budget in it.
    return float(np.fmax(found, lead.expanded_uncertainty))


def _by_results(
    target: Target, measurement: Measurement, results: Mapping[str, VolumetricErrors]
) -> float:
    """Return ``reached`` by the results themselves, without an uncertainty budget."""
    line, parameter = target.line_and_parameter
    if line:
        return _of_test(target, line, parameter, measurement)
    if target.quantity == VOLUMETRIC:
        best = to_rely_on(results)
        if best is None:
            return nan
        chain, plausible = measurement.chain, measurement.plausible
        return COVERAGE_FACTOR * of_result(results[best], chain, plausible).standard_uncertainty
    for name in reversed(in_order_of_reliance(results)):
        spread = _of_result(target.quantity, results[name]) if to_rely_on([name]) else nan
        if isfinite(spread):
            return COVERAGE_FACTOR * spread
    return nan


def _of_result(quantity: str, result: VolumetricErrors) -> float:
    """Return the standard uncertainty of a curve at its worst node or of a squareness error."""
    if quantity in SQUARENESS:
        figure = result.figure(quantity)
        return figure.standard_uncertainty if isfinite(figure.value) else nan
    if quantity not in result.curves or not np.all(np.isfinite(result.curves[quantity])):
        return nan
    return float(np.max(result.standard_uncertainty[quantity]))


def _of_test(target: Target, line: str, parameter: str, measurement: Measurement) -> float:
    """Return the largest U of a parameter over all tests of a line; NaN if one is not known."""
    tests = [one for one in all_runs(measurement) if one.name == line]
    found = [evaluate(one, target.conditions).expanded_uncertainty[parameter] for one in tests]
    return float(np.max(found)) if found else nan


def outlook(pursuit: Pursuit) -> TargetStanding:
    """Return what is to be expected of a run before its first line."""
    with one_thread():
        return _open(pursuit, nan, 0, ORDINARY_STOP, 1.0, "nothing is measured yet")


def standing(
    pursuit: Pursuit,
    measurement: Measurement,
    results: Mapping[str, VolumetricErrors],
    lead: RunLead,
) -> TargetStanding:
    """Return how far a run is from its target after some of its lines.

    Args:
        pursuit: the run and its target.
        measurement: the lines so far, each with its last attempt.
        results: of these lines, method → errors.
        lead: what verdict and report state of them.
    """
    target = pursuit.target
    with one_thread():
        now = reached(target, measurement, results, lead)
        lacking = _lacking(pursuit, measurement) or _unknown_or_large(target, now)
        lacking = lacking or _blind(pursuit, measurement)
        count = len(measurement.lines)
        if lacking:
            stop, pace = _stop_uncertainty(measurement), _pace(pursuit, measurement)
            return _open(pursuit, now, count, stop, pace, lacking)
    return _made(target, now, now, 0.0, TargetState.REACHED, count, "")


def _open(
    pursuit: Pursuit, now: float, count: int, stop: float, pace: float, lacking: str
) -> TargetStanding:
    """Foretell the rest of a run whose target is not reached."""
    target, plan = pursuit.target, pursuit.plan
    here = pursuit.foretold(count, stop) if isfinite(now) else nan
    ratio = now / here if here > 0.0 else 1.0

    def then(lines: int) -> float:
        return ratio * pursuit.foretold(lines, stop)

    last = len(plan.lines)
    expected = then(last) if count < last else now
    ahead = [end for end in pursuit.line_ends if end > count]
    if not ahead or not expected <= target.size:
        why = _beyond(target, lacking, expected, bool(ahead), count == last)
        return _made(target, now, expected, nan, TargetState.BEYOND_PLAN, count, why)
    # The first of the ends from which on the uncertainty is small enough.
    low, high = 0, len(ahead) - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if then(ahead[middle]) <= target.size else (middle + 1, high)
    left = pace * sum(pursuit.line_times[count : ahead[low]])
    return _made(target, now, expected, left, TargetState.OPEN, count, lacking)


def _made(
    target: Target,
    now: float,
    expected: float,
    left: float,
    state: TargetState,
    count: int,
    text: str,
) -> TargetStanding:
    return TargetStanding(
        target.quantity, target.unit, target.size, now, expected, left, state, count, text
    )


def _lacking(pursuit: Pursuit, measurement: Measurement) -> str:
    measured = {line.line_index for line in measurement.lines if line.complete}
    lacking = lacking_runs(pursuit.target, pursuit.plan, measured)
    if not lacking:
        return ""
    line, done, wanted = lacking[0]
    name = f"{line.name} {line.order}".rstrip()
    return f"{name} has {done} of at least {wanted} runs {line.direction}"


def _unknown_or_large(target: Target, now: float) -> str:
    if not isfinite(now):
        return f"the lines so far do not determine {target.words}"
    if now > target.size:
        return _LARGE
    return ""


def _blind(pursuit: Pursuit, measurement: Measurement) -> str:
    """Say what keeps a diagnosis of these lines from showing an effect as large as the target."""
    try:
        power = power_of(measurement)
    except ValueError as error:
        return f"a diagnosis of these lines is not possible: {error}"
    if not power.diagnosed:
        return ""
    if power.why:
        return f"a diagnosis of these lines shows nothing: {power.why}"
    target = pursuit.target
    # An angle acts by the shortest side of the box at least.
    sides = np.asarray(measurement.volume.step) * measurement.volume.blocks
    size = target.size * (float(np.min(sides)) if target.unit == "rad" else 1.0)
    if power.gap <= size:
        return ""
    return (
        f"a diagnosis of these lines shows a gap from {in_micro(power.gap, 'm')} on, which is more"
        " than the target"
    )


def _beyond(target: Target, lacking: str, expected: float, may_end: bool, over: bool) -> str:
    if over:
        return "all lines of the plan are measured" if lacking == _LARGE else lacking
    if not may_end:
        return f"the plan has too few runs: {lacking}"
    return f"about {in_micro(expected, target.unit)} is expected at the end of the plan"


def _stop_uncertainty(measurement: Measurement) -> float:
    told = np.concatenate([line.standard_uncertainty for line in measurement.lines])
    told = told[np.isfinite(told) & (told > 0.0)]
    return float(np.median(told)) if len(told) else ORDINARY_STOP


def _pace(pursuit: Pursuit, measurement: Measurement) -> float:
    """Return how much longer lines have taken than the plan says, from first to last stop."""
    lines = duration(pursuit.plan, pursuit.machine).lines
    took = planned = 0.0
    for line in measurement.lines:
        one = lines[line.line_index]
        took += float(line.time[-1] - line.time[0])
        planned += one.moves + one.dwells * (one.stops - 1) / one.stops
    return took / planned if took > 0.0 and planned > 0.0 else 1.0
