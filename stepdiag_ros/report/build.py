"""From a measurement and what is known of its run to a report: solves by every method."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stepdiag_ros.metrology.geometry import TRANSLATIONS, Vector
from stepdiag_ros.metrology.measurement import Measurement
from stepdiag_ros.metrology.plan import Volume
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.solvers.summary import CurveEstimate, common_figures
from stepdiag_ros.report.content import Report, Truth, same_to_the_last_bit
from stepdiag_ros.solving import solve_reproducibly

if TYPE_CHECKING:
    from stepdiag_ros.metrology.cell import SimulatedCell


def truth_of(cell: "SimulatedCell", volume: Volume, lines: Sequence[str]) -> Truth:
    """Return the truth of a simulated cell over a volume, with the figures of a result.

    Args:
        cell: the simulated cell.
        volume: the measured box.
        lines: names of the measured lines; the true displacement of each body diagonal is given.
    """
    return truth_from_curves(cell.truth(volume), volume, lines)


def truth_from_curves(curves: Mapping[str, Vector], volume: Volume, lines: Sequence[str]) -> Truth:
    """Return a truth from the nine known curves in the frame of the results; see ``truth_of``.

    Args:
        curves: ISO 230-1 name → errors at the nodes, m, each shape (N + 1,).
        volume: the measured box.
        lines: names of the measured lines.

    Raises:
        ValueError: a curve is missing, has another number of values than the box has nodes, or one
            that is no number.
    """
    nine = {}
    for name in TRANSLATIONS:
        if name not in curves:
            raise ValueError(f"the truth has no curve {name}")
        nine[name] = np.asarray(curves[name], dtype=np.float64)
        if nine[name].shape != (volume.blocks + 1,) or not np.all(np.isfinite(nine[name])):
            raise ValueError(
                f"the truth of {name} must be {volume.blocks + 1} numbers, one for each node"
            )
    values = np.concatenate([nine[name] for name in TRANSLATIONS])
    exact = CurveEstimate(
        values=values,
        covariance=np.zeros((values.size, values.size)),
        unseen=np.empty((values.size, 0)),
    )
    return Truth(curves=nine, figures=common_figures(volume, exact, lines))


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
    recorded: Iterable[VolumetricErrors] = (),
    remarks: tuple[str, ...] = (),
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
        recorded: results of the live run in the order of recording; the last of each method is
            compared with what is solved here, to the last bit.
        remarks: about the run as a whole.

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
        equals_recorded=equal,
        remarks=(*remarks, *more),
    )
