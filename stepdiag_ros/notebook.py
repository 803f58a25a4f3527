"""For notebooks and scripts: open a run, solve it, look at it, ask what is missing.

    from stepdiag_ros import open_run, solve, plots
    run = open_run("run.mcap")
    plots.error_curves(solve(run).preferred())

These are the same functions that the commands call, so that a notebook and the command line say the
same bit for bit. What cannot be done is refused in one sentence (``ValueError``).
"""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.metrology.refusal import Refusal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stepdiag_ros.bags.run import RecordedRun
    from stepdiag_ros.evaluation.diagnosis import DiagnosisReport
    from stepdiag_ros.evaluation.report import Report
    from stepdiag_ros.metrology.agreement import MachineChanges
    from stepdiag_ros.metrology.solvers.result import VolumetricErrors
    from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy
    from stepdiag_ros.metrology.volumetric_map import VolumetricMap


def open_run(path: str | Path, run_id: str | None = None) -> "RecordedRun":
    """Open the run that a bag holds.

    Args:
        path: a bag (.mcap), or a folder of ``ros2 bag record``.
        run_id: which run, where a bag holds several.

    Raises:
        ValueError: it cannot be read, or holds no run or several.
    """
    from stepdiag_ros.bags.run import load_run
    from stepdiag_ros.text.sentence import sentence

    try:
        return load_run(path, run_id)
    except OSError as error:
        raise ValueError(sentence(error)) from None


def solve(
    run: "RecordedRun",
    *,
    recorded_lines: bool = False,
    with_visibility: bool = False,
    direct: "Sequence[str | Path]" = (),
) -> "Report":
    """Solve a run by every method that its lines are enough for, as ``stepdiag solve`` does.

    Args:
        run: that was opened.
        recorded_lines: take the lines as recorded; otherwise they are assembled again from the
            readings.
        with_visibility: state for each error what these lines show of it.
        direct: tables of errors measured directly, weighted in (``--direct``).

    Returns:
        The results by method, and what is known of the run; ``preferred()`` is the one to rely on.

    Raises:
        ValueError: there is nothing to solve, a table cannot be read, or the run was measured with
            a tracker (``stepdiag_ros.evaluation.tracker.reports_of_run``).
    """
    from stepdiag_ros.bags.direct_table import load_direct
    from stepdiag_ros.evaluation.recorded_run import report_of_run

    return report_of_run(
        run,
        recorded_lines=recorded_lines,
        with_visibility=with_visibility,
        warn=warnings.warn,
        direct=load_direct(direct),
    )


def error_map(report: "Report", method: str = "") -> "VolumetricMap":
    """Return the error vectors of a solved run anywhere in the measured box.

    Args:
        report: of ``solve``.
        method: that solved; empty: the one to rely on.

    Raises:
        ValueError: there is no such result, or it does not determine the map.
    """
    from stepdiag_ros.metrology.volumetric_map import VolumetricMap

    return VolumetricMap.of_result(_result(report, method), report.chain)


def worst_point(report: "Report", method: str = "") -> "VolumetricAccuracy":
    """Return the longest error vector in the measured box, where it is, and how sure that is.

    Args:
        report: of ``solve``.
        method: that solved; empty: the one to rely on.

    Raises:
        ValueError: there is no such result.
    """
    from stepdiag_ros.metrology.standards.volumetric import of_result

    return of_result(_result(report, method), report.chain, report.plausible)


def diagnose(run: "RecordedRun", model: str = "", *, seed: int = 0) -> "DiagnosisReport":
    """Compare a run with a model of the machine and name what is missing (``stepdiag diagnose``).

    The lines are taken as recorded.

    Args:
        run: that was opened.
        model: of the machine (YAML), by path or name; empty: all error curves free, no further
            effects.
        seed: of the random draws that guard against false names.

    Raises:
        ValueError: the model cannot be read, there is nothing to compare, or the run was measured
            with a tracker.
    """
    from stepdiag_ros.configuration import load_model
    from stepdiag_ros.evaluation.diagnosis import build_diagnosis
    from stepdiag_ros.evaluation.recorded_run import require_standing_beam
    from stepdiag_ros.metrology.effects import catalogue
    from stepdiag_ros.metrology.model import MachineModel

    require_standing_beam(run)
    measurement = run.measurement
    if not measurement.lines:
        raise ValueError(f"{run.path}: no line of this run was finished; nothing can be compared")
    known = load_model(model)[0] if model else MachineModel()
    return build_diagnosis(
        measurement,
        known,
        catalogue(),
        bag=run.path if run.path.is_file() else None,
        run_id=run.run_id,
        model_source=model,
        seed=seed,
    )


def compare(before: "Report", after: "Report", method: str = "") -> "MachineChanges":
    """Compare two solved runs of one machine: every difference with its uncertainty and E_n.

    Args:
        before: the first, of ``solve``.
        after: the second.
        method: that solved both; empty: the one to rely on of those that both were solved by.

    Raises:
        ValueError: they cannot be compared: other boxes, another chain, no common method.
    """
    from stepdiag_ros.evaluation.changes import changes_of, side_of_report

    return changes_of(side_of_report(before, method), side_of_report(after, method))


def _result(report: "Report", method: str) -> "VolumetricErrors":
    found = report.preferred() if not method else None
    for one in report.results:
        if one.method == method:
            found = one
    if found is None:
        solved = ", ".join(one.method for one in report.results) or "none"
        raise Refusal(
            f"there is no result of the method '{method}'; solved were: {solved}",
            fault="not_found",
            aspect="method",
        )
    return found
