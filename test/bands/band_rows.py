"""Every estimator with a ± on one plausible machine: how far off, and what it said of that.

Each function returns rows: name of the row → errors (estimate less truth) and standard
uncertainties, arrays of one length; NaN in either where the estimator says unknown. What the frame
fixes (the first node, the last of three curves) is no estimate and not counted.
"""

from collections import defaultdict
from dataclasses import replace

import numpy as np
from plausible_machines import FIXED_AT_END

from stepdiag_ros.metrology.agreement import ComparedMeasurement, compare
from stepdiag_ros.metrology.discrepancy import diagnose
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.geometry import AXES, ROTATIONS, SQUARENESS
from stepdiag_ros.metrology.setup_errors import setup_errors
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.metrology.standards.axis_test import all_runs
from stepdiag_ros.metrology.standards.diagonal_squareness import squareness_of
from stepdiag_ros.metrology.standards.iso230_2 import PARAMETERS, evaluate
from stepdiag_ros.metrology.standards.iso230_6 import diagonal_groups
from stepdiag_ros.metrology.standards.positioning_uncertainty import UncertaintyDescription
from stepdiag_ros.metrology.standards.volumetric import of_result
from stepdiag_ros.metrology.uncertainty.budget import make_budget
from stepdiag_ros.metrology.uncertainty.instrument import Spread
from stepdiag_ros.metrology.volumetric_map import VolumetricMap

NORMAL_95 = 1.959964
STEP_METHODS = ("conventional", "setup_robust", "alternative", "least_squares", "rigid_body")
ORDER_METHODS = ("soons", "least_squares", "rigid_body")
_KINDS = {
    "positioning": "positioning",
    "straightness": "straightness",
    "angular": "angular errors",
    "angular-shape": "angular errors' shapes",
    "shape": "angular errors' shapes",
    "diagonal": "diagonals",
    "tilt": "setup tilts",
}
PLACES = 200


class Rows:
    """Collects errors and uncertainties under the names of rows."""

    def __init__(self):
        self._parts = defaultdict(list)

    def add(self, row, errors, uncertainties):
        both = np.broadcast_arrays(np.atleast_1d(errors), np.atleast_1d(uncertainties))
        self._parts[row].append(np.array(both, dtype=np.float64).reshape(2, -1))

    def all(self):
        return {row: np.concatenate(parts, axis=1) for row, parts in self._parts.items()}


def _free(curve, size):
    """Return which nodes of a curve the frame does not fix."""
    return slice(1, size - 1 if curve in FIXED_AT_END else size)


def add_result(rows, prefix, truth, result):
    """Add curves at their nodes and figures of a solver's result."""
    for name, values in result.curves.items():
        here = _free(name, len(values))
        kind = "angles at nodes" if name in ROTATIONS else "curves at nodes"
        errors = values[here] - truth.curves[name][here]
        rows.add(f"{prefix}: {kind}", errors, result.standard_uncertainty[name][here])
    for figure in result.figures:
        first, _, rest = figure.name.partition(" ")
        if first in ("lambda", "delta"):
            continue
        kind = "squareness" if first in SQUARENESS else _KINDS[first]
        if first == "tilt":
            setup, _, which = rest.rpartition(" ")
            true = truth.tilts(setup, setup.split()[0])[int(which) - 1]
        else:
            true = truth.figures[
                figure.name.replace("shape", "angular-shape") if first == "shape" else figure.name
            ]
        rows.add(f"{prefix}: {kind}", figure.value - true, figure.standard_uncertainty)


def add_volume(rows, prefix, truth, result):
    """Add volumetric accuracy, error vectors at places, and what remains when they are removed."""
    true_map, chain = truth.error_map, truth.machine.chain
    accuracy = of_result(result, chain)
    lengths = np.linalg.norm(true_map.errors(true_map.grid()), axis=1)
    rows.add(
        f"{prefix}: volumetric accuracy",
        accuracy.value - np.max(lengths),
        accuracy.standard_uncertainty,
    )
    found = VolumetricMap.of_result(result, chain)
    # At the first corner the error vector is zero by definition.
    every = found.grid()[1:]
    places = every[:: -(-len(every) // PLACES)]
    left = found.errors(places) - true_map.errors(places)
    spread = found.standard_uncertainty_at(places)
    rows.add(f"{prefix}: error vectors in the volume", left, spread)
    # What is left when all that was found is compensated is as large as the uncertainty says.
    rms, told = (np.sqrt(np.mean(np.sum(part**2, axis=1))) for part in (left, spread))
    rows.add(f"{prefix}: rms left in the volume after compensation", rms, told)


def step_rows(machine):
    """Return the rows of one order of moves with linear lines, measured on two days."""
    rows, plan = Rows(), machine.steps()
    truth = machine.truth(plan.volume)
    first, later = (machine.measure(plan, day) for day in (0, 1))
    for method in STEP_METHODS:
        result = solve(first, method)
        add_result(rows, method, truth, result)
        if method in ("setup_robust", "least_squares", "rigid_body"):
            add_volume(rows, method, truth, result)
        budget = make_budget(first, machine.instrument, method)
        add_budget(rows, method, truth, budget)
        if method == "least_squares":
            add_changes(rows, machine, first, later, result, budget)
    for one in setup_errors(first):
        setup = next(line.setup for line in first.lines if line.line.name == one.line)
        true = truth.tilts(setup, one.line)
        rows.add("setup errors: tilts", one.angles - true, one.angle_uncertainty)
    return rows.all()


def solved_rows(machine, truth, measured):
    """Return the rows of results and budgets, of which nobody has stated the angular errors."""
    rows, unstated = Rows(), replace(machine.instrument, angular_errors=Spread())
    for method in ("setup_robust", "least_squares"):
        add_result(rows, method, truth, solve(measured, method))
        add_budget(rows, method, truth, make_budget(measured, unstated, method))
    return rows.all()


def add_budget(rows, method, truth, budget):
    """Add the quantities of a budget; U is its own, k as it says."""
    spread = budget.expanded / NORMAL_95
    for row, quantity in enumerate(budget.sensitivity.quantities):
        kind, true = "curves at nodes", None
        if quantity.curve:
            kind = "angles at nodes" if quantity.curve in ROTATIONS else kind
            true = truth.curves[quantity.curve][quantity.node]
        else:
            first = quantity.name.partition(" ")[0]
            kind = "squareness" if first in SQUARENESS else _KINDS[first]
            true = truth.figures[quantity.name]
        rows.add(f"budget {method}: {kind}", budget.sensitivity.values[row] - true, spread[row])


def add_changes(rows, machine, first, later, result, budget):
    """Add differences between two days of a machine that has not changed; U with k = 2."""
    again = solve(later, result.method)
    pairs = {
        "changes": (
            ComparedMeasurement(result, machine.chain, first),
            ComparedMeasurement(again, machine.chain, later),
        ),
        "changes with budgets": (
            ComparedMeasurement(result, machine.chain, first, budget),
            ComparedMeasurement(
                again,
                machine.chain,
                later,
                make_budget(later, machine.instrument, result.method),
            ),
        ),
    }
    for name, (before, after) in pairs.items():
        changes = compare(before, after, same_instrument=True)
        for one in changes.curves:
            here = _free(one.name, len(one.before))
            rows.add(
                f"{name}: curves at nodes", one.difference[here], one.difference_uncertainty[here]
            )
        for one in changes.every_figure:
            kind = "volume" if one.family == "volume" else "figures"
            rows.add(f"{name}: {kind}", one.difference, one.difference_uncertainty)


def order_rows(machine):
    """Return the rows of three orders of moves with linear lines at the corner and far edges."""
    rows, plan = Rows(), machine.orders()
    truth = machine.truth(plan.volume)
    measured = machine.measure(plan)
    for method in ORDER_METHODS:
        result = solve(measured, method)
        name = method if method == "soons" else f"{method}, three orders"
        add_result(rows, name, truth, result)
        if method == "rigid_body":
            add_volume(rows, name, truth, result)
            budget = make_budget(measured, machine.instrument, method)
            add_budget(rows, name, truth, budget)
    return rows.all()


def conditions(machine):
    """Return what the user of ISO 230-2 knows of the measuring conditions, ISO/TR 230-9."""
    known = machine.instrument
    squares = (
        known.wavelength.standard_uncertainty**2
        + (0.93e-6 * known.air_temperature.standard_uncertainty) ** 2
        + (0.93e-6 * known.air_gradient.standard_uncertainty) ** 2
        + (2.7e-9 * known.air_pressure.standard_uncertainty) ** 2
        + (0.85e-6 * known.relative_humidity.standard_uncertainty) ** 2
    )
    spread = np.hypot(machine.wander, machine.cell.reading_noise)
    return UncertaintyDescription(
        device=2.0 * float(np.sqrt(squares)),
        misalignment=0.0,
        temperature_range=0.0,
        expansion_coefficient=0.0,
        expansion_range=0.0,
        temperature_difference=0.0,
        # The range of a wander that is even in its limits has a standard deviation of r/(2·√3).
        environmental_variation=float(2.0 * np.sqrt(3.0) * spread),
    )


def standard_rows(machine):
    """Return the rows of ISO 230-2, ISO 230-6 and of squareness from diagonals."""
    rows, plan = Rows(), machine.standard_lines()
    truth = machine.truth(plan.volume)
    measured, exact = machine.measure(plan), machine.exact(plan)
    told = conditions(machine)
    tests = [evaluate(runs, told) for runs in all_runs(measured)]
    true = {runs.name: evaluate(runs) for runs in all_runs(exact)}
    for test in tests:
        for name in PARAMETERS:
            rows.add(
                f"{test.standard}: {name.rstrip('↑↓')}",
                test.parameters[name] - true[test.name].parameters[name],
                test.expanded_uncertainty[name] / 2.0,
            )
    groups = zip(diagonal_groups(tests), diagonal_groups(list(true.values())), strict=True)
    for found, sure in groups:
        for name in ("systematic_deviation", "reversal_value"):
            short = {"systematic_deviation": "E_d", "reversal_value": "B_d"}[name]
            spread = getattr(found, name.split("_")[0] + "_uncertainty")
            rows.add(
                f"ISO 230-6: {short} of the machine",
                getattr(found, name) - getattr(sure, name),
                spread / 2.0,
            )
    squareness = squareness_of(measured)
    for one in squareness.values:
        kind = "face" if len(one.diagonals) == 2 else "body"
        rows.add(
            f"squareness from {kind} diagonals",
            one.value - truth.end_to_end[one.name],
            one.standard_uncertainty,
        )
    mean = sum(
        length * truth.curves[f"E_{axis}{axis}"][-1]
        for axis, length in zip("XYZ", machine.travel, strict=True)
    ) / np.linalg.norm(machine.travel)
    rows.add(
        "squareness from diagonals: mean length error",
        squareness.mean_length_error - mean,
        squareness.mean_length_uncertainty,
    )
    rows.add(
        "squareness from diagonals: closure", squareness.closure, squareness.closure_uncertainty
    )
    return rows.all()


def diagnosis_rows(machine):
    """Return the rows of the sizes of effects, one effect hidden in each machine."""
    rows, plan = Rows(), machine.steps()
    hidden = _hidden(machine, plan)
    found = diagnose(machine.measure(plan, effects=(hidden,)))
    (name, true), label = next(iter(hidden.sizes.items())), hidden.effect.label(hidden.setting)
    for kind, findings in (("named", found.findings), ("partial", found.partial)):
        low, high = np.nan, np.nan
        for one in findings:
            if one.label == label:
                low, high = one.band[name]
        row = f"diagnosis: sizes of {kind} effects"
        rows.add(row, 0.5 * (low + high) - true, 0.5 * (high - low) / NORMAL_95)
    return rows.all()


def _hidden(machine, plan):
    """Return an effect, well above the noise, and its size."""
    rng, known = np.random.default_rng([machine.seed, 8]), catalogue()
    size = float(rng.uniform(1e-6, 3e-6))
    duration = machine.measure(plan).lines[-1].time[-1]
    axis, pair = str(rng.choice(list(AXES))), str(rng.choice(["XY", "XZ", "YZ"]))
    name, setting, sizes = [
        ("backlash", {"axis": axis}, {"lost_motion": size}),
        ("drift", {"along": axis}, {"m_per_s": 2.0 * size / duration}),
        ("sag", {"error": axis, "over": pair}, {"corner": 2.0 * size}),
    ][int(rng.integers(3))]
    return ActiveEffect(known[name], setting, sizes)


def all_rows(machine):
    """Return the rows of every estimator on one machine."""
    made = {}
    for rows_of in (step_rows, order_rows, standard_rows, diagnosis_rows):
        made.update(rows_of(machine))
    return made
