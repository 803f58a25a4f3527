"""From a measurement and what is known of its run to a report: solves by every method."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stepdiag_ros.bags.passes import Completeness
from stepdiag_ros.bags.tally import Flaw
from stepdiag_ros.evaluation.report import (
    Report,
    Truth,
    same_but_for_rounding,
    same_to_the_last_bit,
)
from stepdiag_ros.evaluation.solving import one_thread, solve_reproducibly
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.geometry import CURVES, ROTATIONS, TRANSLATIONS, Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.solvers.summary import CurveEstimate, common_figures
from stepdiag_ros.metrology.visibility import Visibility, measured_visibility

if TYPE_CHECKING:
    from stepdiag_ros.metrology.cell import SimulatedCell


def truth_of(cell: "SimulatedCell", volume: Volume, lines: Sequence[str]) -> Truth:
    """Return the true errors of a simulated cell over a volume, with the figures of a result.

    Args:
        cell: the simulated cell.
        volume: the measured box.
        lines: names of the measured lines; the true displacement of each body diagonal is given.
    """
    return truth_from_curves(cell.truth(volume), volume, lines, cell.chain)


def truth_from_curves(
    curves: Mapping[str, Vector], volume: Volume, lines: Sequence[str], chain: str = ""
) -> Truth:
    """Return a truth from known curves in the frame of the results; see ``truth_of``.

    Args:
        curves: ISO 230-1 name → errors at the nodes, m or rad, each shape (N + 1,): the nine
            translations, or all eighteen.
        volume: the measured box.
        lines: names of the measured lines.
        chain: order of the machine's axes; without it rotations are left out.

    Raises:
        ValueError: a curve is missing, has another number of values than the box has nodes, or one
            that is not a number.
    """
    known = {}
    turns = chain and any(name in curves for name in ROTATIONS)
    names = CURVES if turns else TRANSLATIONS
    for name in names:
        if name not in curves:
            raise ValueError(f"the true errors lack the curve {name}")
        known[name] = np.asarray(curves[name], dtype=np.float64)
        if known[name].shape != (volume.blocks + 1,) or not np.all(np.isfinite(known[name])):
            raise ValueError(
                f"the true errors {name} must be {volume.blocks + 1} numbers, one for each node"
            )
    values = np.concatenate(list(known.values()))
    exact = CurveEstimate(
        values=values,
        covariance=np.zeros((values.size, values.size)),
        unseen=np.empty((values.size, 0)),
        names=names,
    )
    return Truth(
        nodes=volume.all_nodes, curves=known, figures=common_figures(volume, exact, lines, chain)
    )


def _visibility(measurement: Measurement) -> Visibility:
    with one_thread():
        return measured_visibility(measurement)


def build_report(
    measurement: Measurement,
    *,
    run_id: str = "",
    plan: str = "",
    machine: str = "",
    chain: str = "",
    run_software_version: str = "",
    simulated: bool | None = None,
    truth: Truth | None = None,
    bag: Path | None = None,
    with_visibility: bool = False,
    recorded: Iterable[VolumetricErrors] = (),
    remarks: tuple[str, ...] = (),
    verdict: Verdict | None = None,
    passes: Completeness | None = None,
    recording: tuple[Flaw, ...] = (),
) -> Report:
    """Solve a measurement by every method that its lines are enough for, and gather the report.

    Args:
        measurement: the finished lines.
        run_id: identity of the run.
        plan: name of the test plan.
        machine: name of the machine.
        chain: order of its axes from workpiece to tool.
        run_software_version: of stepdiag_ros that made the run.
        simulated: whether the run was made on a simulated cell; None if unknown.
        truth: of the simulated cell, see ``truth_of``; None if unknown.
        bag: the file that it was recorded in.
        with_visibility: state for each error whether these lines determine it.
        recorded: results of the live run in the order of recording; the last of each method is
            compared with what is solved here, bit for bit.
        remarks: about the run as a whole.
        verdict: of a diagnosis of these lines; None if they were not diagnosed.
        passes: how much of the plan was measured; None if that is not known.
        recording: what is wrong with the recording.

    Raises:
        ValueError: there is no line, or the lines contradict each other or the volume.
    """
    if not measurement.lines:
        raise ValueError(f"{bag or 'this run'}: no line was finished, so there is nothing to solve")
    results, refused = solve_reproducibly(measurement)
    last = {result.method: result for result in recorded}
    equal: dict[str, bool] = {}
    more: list[str] = []
    for method, result in results.items():
        if method not in last:
            continue
        equal[method] = same_to_the_last_bit(result, last[method])
        if result.lines != last[method].lines:
            more.append(
                f"the recorded {method} result was made from {last[method].lines} lines,"
                f" this one from {result.lines}"
            )
    return Report(
        results=tuple(results.values()),
        refused=refused,
        run_id=run_id,
        plan=plan,
        machine=machine,
        chain=chain,
        run_software_version=run_software_version,
        bag=bag,
        simulated=simulated,
        truth=truth,
        measurement=measurement,
        visibility=_visibility(measurement) if with_visibility else None,
        equals_recorded=equal,
        rounded=frozenset(
            method
            for method, same in equal.items()
            if not same and same_but_for_rounding(results[method], last[method])
        ),
        remarks=(*remarks, *more),
        verdict=verdict or Verdict(),
        passes=passes,
        recording=recording,
    )
