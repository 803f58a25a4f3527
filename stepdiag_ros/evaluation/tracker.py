"""From a recorded run with a tracker to what is shown of each of its stations."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stepdiag_ros.bags.passes import completeness_of, incomplete_sentences
from stepdiag_ros.bags.run import RecordedRun
from stepdiag_ros.configuration import cell_from_text
from stepdiag_ros.evaluation.build import truth_of
from stepdiag_ros.evaluation.recorded_run import measurement_of, out_of_step, silent
from stepdiag_ros.evaluation.report import Report, same_to_the_last_bit
from stepdiag_ros.evaluation.solving import one_thread
from stepdiag_ros.metrology.air.recompensation import AirChoice
from stepdiag_ros.metrology.discrepancy.summary import Verdict
from stepdiag_ros.metrology.geometry import Vector
from stepdiag_ros.metrology.solvers.tracker_methods import SEVEN_LINES
from stepdiag_ros.metrology.standards.positioning_uncertainty import UncertaintyDescription
from stepdiag_ros.metrology.tracker.campaign import true_values
from stepdiag_ros.metrology.tracker.curves import grid_of
from stepdiag_ros.metrology.tracker.evaluation import SevenLineResult
from stepdiag_ros.metrology.tracker.location import Location
from stepdiag_ros.metrology.tracker.run_result import (
    errors_of,
    evaluate_station,
    grid_errors,
    station_runs,
)
from stepdiag_ros.metrology.tracker.verdict import verdict_on


@dataclass(frozen=True)
class TrackerReport:
    """What is shown of one station.

    Attributes:
        source: file of the readings.
        station: name of the tracker's place.
        location: of the tracker.
        result: of the seven lines; None if only the place was asked for.
        truth: of the simulated machine, in the order of ``joint.NAMES``; None: it is not known.
        remarks: on the run that the readings are of, in words.
        left_out: what was measured and is not among the readings, in words.
        equals_recorded: the joint estimate is the recorded one bit for bit; None if none was
            recorded.
    """

    source: str
    station: str
    location: Location
    result: SevenLineResult | None = None
    truth: Vector | None = None
    remarks: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    equals_recorded: bool | None = None

    @property
    def verdict(self) -> Verdict:
        """Return whether one machine and one tracker explain all readings."""
        if self.result is None:
            return Verdict()
        return Verdict(*verdict_on(self.result.joint))


def reports_of_run(
    recorded: RecordedRun,
    progress: Callable[[float], None] = silent,
    recorded_lines: bool = False,
    air: AirChoice | None = None,
    warn: Callable[[str], None] = silent,
    description: UncertaintyDescription | None = None,
) -> tuple[TrackerReport, ...]:
    """Evaluate the seven lines of every station of a recorded run.

    Args:
        recorded: the run; its plan has a tracker.
        progress: called with the part that has been read, 0..1.
        recorded_lines: take the lines as recorded even where the bag has the readings.
        air: compensate the readings for the air again; None: as it was done in the run.
        warn: called with a sentence if the lines differ from the recorded ones.
        description: of the measuring conditions, for the uncertainty of ISO 230-2 and -6.

    Raises:
        ValueError: nothing was measured, or a station cannot be evaluated; names it.
    """
    measurement, remark = measurement_of(recorded, recorded_lines, progress, air, warn)
    passes = completeness_of(recorded, measurement)
    runs = station_runs(recorded.plan, measurement.lines)
    if not runs:
        raise ValueError(f"{recorded.path}: no line was finished, so there is nothing to evaluate")
    made = []
    for run in runs:
        try:
            with one_thread():
                result = evaluate_station(run, recorded.plan, recorded.chain, description)
        except ValueError as error:
            raise ValueError(f"{recorded.path}: station {run.station}: {error}") from None
        errors = errors_of(run, result, measurement.lines)
        live = [one for one in recorded.results if one.method == SEVEN_LINES.name]
        equal = None
        if live and errors is not None and air is None:
            equal = any(same_to_the_last_bit(errors, one) for one in live)
        said = (*incomplete_sentences(passes), f"Lines: {remark}.")
        made.append(
            TrackerReport(
                str(recorded.path),
                run.station,
                result.location,
                result,
                _truth(recorded, result),
                (*said, *out_of_step(recorded)),
                run.remarks,
                equal,
            )
        )
    return tuple(made)


def grid_report(
    recorded: RecordedRun,
    progress: Callable[[float], None] = silent,
    recorded_lines: bool = False,
    warn: Callable[[str], None] = silent,
) -> Report:
    """Return the error curves from the grid of a recorded run, as those of any other solver.

    Args:
        recorded: the run; its plan has a tracker and a grid.
        progress: called with the part that has been read, 0..1.
        recorded_lines: take the lines as recorded even where the bag has the readings.
        warn: called with a sentence if the lines differ from the recorded ones.

    Raises:
        ValueError: the machine's chain is not known, or the readings do not determine them; names
            the bag.
    """
    measurement, remark = measurement_of(recorded, recorded_lines, progress, None, warn)
    if not recorded.chain:
        raise ValueError(f"{recorded.path}: error curves need the order of the machine's axes")
    try:
        with one_thread():
            result = grid_errors(measurement.lines, recorded.plan, recorded.chain)
    except ValueError as error:
        raise ValueError(f"{recorded.path}: {error}") from None
    truth = None
    if recorded.cell_text:
        volume = grid_of(
            np.unique(np.concatenate([one.target for one in measurement.lines]), axis=0)
        )
        cell = cell_from_text(recorded.cell_text, f"{recorded.path}: simulated cell")
        truth = truth_of(cell, volume, ())
    return Report(
        results=(result,),
        run_id=recorded.run_id,
        chain=recorded.chain,
        plan=recorded.plan.name,
        bag=recorded.path,
        truth=truth,
        remarks=(remark,),
        passes=completeness_of(recorded, measurement),
    )


def _truth(recorded: RecordedRun, result: SevenLineResult) -> Vector | None:
    if not recorded.cell_text or result.joint is None:
        return None
    cell = cell_from_text(recorded.cell_text, f"{recorded.path}: simulated cell")
    return true_values(cell, result.joint.machine.box)
