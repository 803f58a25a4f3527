"""``stepdiag tracker locate``, ``evaluate`` and ``multilaterate``: of a table, or of a bag."""

from argparse import Namespace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepdiag_ros.commands.arguments import results_folder
from stepdiag_ros.commands.output import progress_bar, show_report, warn
from stepdiag_ros.commands.standard_tests import is_bag, show

if TYPE_CHECKING:
    from stepdiag_ros.bags.run import RecordedRun
    from stepdiag_ros.evaluation.tracker import TrackerReport
    from stepdiag_ros.metrology.tracker.readings import TrackerReading


def run_locate(arguments: Namespace) -> int:
    """Locate the tracker; see the module."""
    return _show_station(arguments, "locate")


def run_evaluate(arguments: Namespace) -> int:
    """Evaluate a seven-line test; see the module."""
    if is_bag(arguments.table):
        return show_run(
            _loaded(arguments.table), arguments, results_folder(arguments.table, "evaluate")
        )
    return _show_station(arguments, "evaluate")


def _show_station(arguments: Namespace, what: str) -> int:
    from stepdiag_ros.configuration import load_cell, load_tracker
    from stepdiag_ros.evaluation.tracker import TrackerReport
    from stepdiag_ros.metrology.tracker.campaign import true_values
    from stepdiag_ros.metrology.tracker.evaluation import evaluate_test, locate_from
    from stepdiag_ros.plots.files.tracker import draw_tracker
    from stepdiag_ros.report.documents.tracker import tracker_json
    from stepdiag_ros.report.tables.tracker import print_tracker

    station, readings = _one_station(arguments)
    tracker, _ = load_tracker(arguments.tracker)
    if what == "evaluate":
        result = evaluate_test(
            readings,
            _conditions(arguments.uncertainty),
            tracker.minimum_range,
            arguments.chain,
        )
        truth = None
        if arguments.cell and result.joint is not None:
            truth = true_values(load_cell(arguments.cell)[0], result.joint.machine.box)
        report = TrackerReport(str(arguments.table), station, result.location, result, truth)
    else:
        location = locate_from(readings, tracker.minimum_range)
        report = TrackerReport(str(arguments.table), station, location)
    return show(
        f"tracker_{what}",
        tracker_json(report),
        lambda console: print_tracker(report, console),
        lambda: draw_tracker(report),
        arguments,
        results_folder(arguments.table, what),
    )


def _loaded(bag: Path) -> "RecordedRun":
    from stepdiag_ros.bags.run import load_run

    return load_run(bag)


def show_run(recorded: "RecordedRun", arguments: Namespace, default_folder: Path) -> int:
    """Evaluate a recorded run with a tracker and show each station; return the exit code.

    Args:
        recorded: the run; its plan has a tracker.
        arguments: parsed, with the options of ``add_output_options``.
        default_folder: where results go if the user named no folder.
    """
    from stepdiag_ros.evaluation.tracker import grid_report, reports_of_run
    from stepdiag_ros.metrology.tracker.run_result import is_grid
    from stepdiag_ros.plots.files.tracker import draw_tracker
    from stepdiag_ros.report.documents.tracker import tracker_json
    from stepdiag_ros.report.tables.tracker import print_tracker

    choices = vars(arguments)
    with progress_bar(f"reading {recorded.path.name}") as progress:
        lines = bool(choices.get("recorded_lines"))
        if is_grid(recorded.plan):
            grid = grid_report(recorded, progress, lines, warn)
        else:
            conditions = _conditions(choices.get("uncertainty"))
            reports = reports_of_run(recorded, progress, lines, None, warn, conditions)
    if is_grid(recorded.plan):
        return show_report(grid, arguments, default_folder)
    chosen = _chosen(reports, choices.get("station") or "", recorded.path, arguments.json)
    for report in chosen:
        folder = arguments.output or default_folder
        if len(chosen) > 1:
            folder = folder / f"station_{report.station}"
        show(
            "tracker_evaluate",
            tracker_json(report),
            partial(print_tracker, report),
            partial(draw_tracker, report),
            Namespace(**{**choices, "output": folder}),
            folder,
        )
        if report.equals_recorded is False:
            warn(f"station {report.station}: the numbers differ from the result in the bag")
    return 0


def _chosen(
    reports: "tuple[TrackerReport, ...]", station: str, source: Path, one: bool
) -> "tuple[TrackerReport, ...]":
    names = [report.station for report in reports]
    if station and station not in names:
        raise ValueError(f"{source}: there is no station '{station}'; there are {', '.join(names)}")
    found = tuple(report for report in reports if not station or report.station == station)
    if one and len(found) > 1:
        raise ValueError(
            f"{source} has the stations {', '.join(names)}: --json shows one; choose it with"
            " 'stepdiag tracker evaluate --station'"
        )
    return found


def run_points(arguments: Namespace) -> int:
    """Multilaterate; see the module."""
    from stepdiag_ros.bags.tracker_table import read_table
    from stepdiag_ros.configuration import load_cell
    from stepdiag_ros.evaluation.build import truth_of
    from stepdiag_ros.evaluation.report import Report
    from stepdiag_ros.metrology.plan import Volume
    from stepdiag_ros.metrology.tracker.campaign import points_from
    from stepdiag_ros.metrology.tracker.curves import error_curves, grid_of

    readings = read_table(arguments.table)
    with progress_bar("multilaterating"):
        points = points_from(readings)
        result = error_curves(points, arguments.chain)
    truth = None
    if arguments.cell:
        volume: Volume = grid_of(points.commanded)
        truth = truth_of(load_cell(arguments.cell)[0], volume, ())
    report = Report(
        results=(result,),
        chain=arguments.chain,
        plan=arguments.table.stem,
        truth=truth,
        remarks=(f"{len(points.commanded)} points from {len(points.stations)} stations",),
    )
    folder = results_folder(arguments.table, "multilaterate")
    return show_report(report, arguments, folder)


def _one_station(arguments: Namespace) -> "tuple[str, tuple[TrackerReading, ...]]":
    from stepdiag_ros.bags.tracker_table import read_table
    from stepdiag_ros.metrology.tracker.readings import stations_of

    groups = stations_of(read_table(arguments.table))
    if arguments.station:
        if arguments.station not in groups:
            raise ValueError(
                f"{arguments.table}: there is no station '{arguments.station}'; there are"
                f" {', '.join(groups)}"
            )
        return arguments.station, groups[arguments.station]
    if len(groups) > 1:
        raise ValueError(
            f"{arguments.table} has the stations {', '.join(groups)}: choose one with --station"
        )
    return next(iter(groups.items()))


def _conditions(path: Path | None) -> Any:
    from stepdiag_ros.configuration import read_yaml
    from stepdiag_ros.metrology.standards.positioning_uncertainty import UncertaintyDescription

    if path is None:
        return UncertaintyDescription()
    return UncertaintyDescription.from_mapping(read_yaml(path), str(path))
