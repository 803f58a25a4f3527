"""From two solved measurements to their comparison: for a command, a notebook and a page alike."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path

from stepdiag_ros.compensation.identified import Identified, from_results_file
from stepdiag_ros.evaluation.report import Report
from stepdiag_ros.metrology.agreement import ComparedMeasurement, MachineChanges, compare
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers.catalogue import to_rely_on
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.uncertainty.budget import make_budget
from stepdiag_ros.metrology.uncertainty.instrument import Instrument


@dataclass(frozen=True)
class ChangesReport:
    """Two measurements and what they say of the machine.

    Attributes:
        before: origin and remarks of the first.
        after: of the second.
        changes: between them.
        instruments: names of the instrument files of both; empty where none was given.
    """

    before: Identified
    after: Identified
    changes: MachineChanges
    instruments: tuple[str, str] = ("", "")


@dataclass(frozen=True)
class Side:
    """One of two measurements, solved.

    Attributes:
        name: of it in sentences.
        results: method → its result, the one to rely on last.
        chain: order of the machine's axes; empty if not known.
        measurement: the lines; None where they are not at hand.
    """

    name: str
    results: Mapping[str, VolumetricErrors]
    chain: str
    measurement: Measurement | None


def side_of_report(report: Report, method: str = "") -> Side:
    """Return a measurement that was solved from its lines.

    Args:
        report: of the run.
        method: that alone is to be compared; empty: any that it was solved by.

    Raises:
        ValueError: there is no such result, or none at all.
    """
    results = {one.method: one for one in report.ordered_results()}
    kept = {name: one for name, one in results.items() if method in ("", name)}
    if not kept:
        raise Refusal(
            f"there is no result of the method '{method}'; solved were:"
            f" {', '.join(results) or 'none'}",
            fault="not_found",
        )
    name = report.run_id if report.bag is None else str(report.bag)
    return Side(name, kept, report.chain, report.measurement)


def side_of_results_file(path: Path, method: str, sha256: str) -> tuple[Side, Identified]:
    """Return a measurement that only its ``results.json`` is left of, and where it comes from.

    Args:
        path: of the file.
        method: of the solver; empty: the one to rely on.
        sha256: of the file.

    Raises:
        ValueError: the file cannot be read, or contains no errors by this method.
    """
    found = from_results_file(path, method, sha256)
    told = found.error_map
    result = VolumetricErrors(
        method=found.origin.method,
        nodes=told.nodes,
        curves=dict(told.curves),
        standard_uncertainty=dict(told.standard_uncertainty),
        figures=(),
        lines=0,
        chi_squared=nan,
        degrees_of_freedom=0,
        frame=told.frame,
    )
    return Side(str(path), {result.method: result}, told.chain, None), found


def common_method(before: Side, after: Side) -> str:
    """Return the method to rely on of those that both were solved by.

    Raises:
        ValueError: no method has determined them.
    """
    common = [method for method in before.results if method in after.results]
    if len(common) == 1:
        return common[0]
    best = to_rely_on(common)
    if best is None:
        raise Refusal(
            f"no method to rely on has a result of both: {before.name} was solved by"
            f" {', '.join(before.results)}, {after.name} by {', '.join(after.results)}",
            fault="mismatch",
        )
    return best


def changes_of(
    before: Side,
    after: Side,
    *,
    instruments: Sequence[Instrument] = (),
    same_instrument: bool = False,
    expansion: float = nan,
    material_temperature: float | None = None,
) -> MachineChanges:
    """Compare two measurements by the method to rely on of those that both were solved by.

    Args:
        before: the first.
        after: the second.
        instruments: what is known of laser, sensors, material and setup: of both, or of each; none:
            uncertainties are those of the solver.
        same_instrument: one laser with its sensors measured both.
        expansion: coefficient that both were corrected to 20 °C with, 1/K; NaN: they were not.
        material_temperature: °C, instead of the recorded one.

    Raises:
        ValueError: they cannot be compared: other boxes, another chain, no common method.
    """
    method = common_method(before, after)

    def measured(side: Side, instrument: Instrument | None) -> ComparedMeasurement:
        budget = None
        if instrument is not None and side.measurement is not None:
            budget = make_budget(
                side.measurement,
                instrument,
                method,
                expansion=expansion,
                material_temperature=material_temperature,
            )
        return ComparedMeasurement(side.results[method], side.chain, side.measurement, budget)

    first, second = (instruments[0], instruments[-1]) if instruments else (None, None)
    return compare(measured(before, first), measured(after, second), same_instrument)
