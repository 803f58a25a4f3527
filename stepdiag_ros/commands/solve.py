"""``stepdiag solve``: from a bag to volumetric errors, without any node."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from stepdiag_ros.commands.air import add_air_options, air_choice
from stepdiag_ros.commands.corrections import add_correction_options, corrected
from stepdiag_ros.commands.output import (
    HelpFormatter,
    Progress,
    add_result_options,
    add_run_option,
    progress_bar,
    say,
    show_report,
)

if TYPE_CHECKING:
    from stepdiag_ros.bags.run import RecordedRun
    from stepdiag_ros.metrology.air.recompensation import AirChoice
    from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement, Reading
    from stepdiag_ros.report.content import Report, Truth

_READINGS_BETWEEN_STEPS = 1000
TARGET_CORRECTION = "target correction"
"""End of the name under which the bridge tells of target correction on /diagnostics."""
_WARN = 1


def add_parser(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "solve",
        help="compute the volumetric errors of a recorded measurement",
        description="Compute positioning, straightness and squareness errors of all axes from a"
        " bag, by every method that the measured lines are enough for. Where the bag has the"
        " interferometer's readings, the lines are assembled again from them, as in the live run;"
        " the result is then compared with the recorded one to the last bit.",
        epilog="examples:\n"
        "  stepdiag solve run.mcap                 tables here, pictures in run_results/\n"
        "  stepdiag solve run.mcap --json          the same as JSON\n"
        "  stepdiag solve run.mcap --pictures pdf  pictures for print\n"
        "  stepdiag solve run.mcap --visibility    what these lines can tell of each error\n"
        "  stepdiag solve run.mcap --expansion-per-K 11.5e-6   corrected to 20 °C\n"
        "  stepdiag solve run.mcap --air own --dead-path 0.35  compensated for the air anew",
        formatter_class=HelpFormatter,
    )
    parser.add_argument(
        "bag", type=Path, help="the measurement: a bag (.mcap), or a folder of 'ros2 bag record'"
    )
    add_run_option(parser)
    parser.add_argument(
        "--recorded-lines",
        action="store_true",
        help="solve from the lines as recorded, do not assemble them again from the readings",
    )
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="FILE",
        help="compare with known error curves: YAML with E_XX ... E_ZZ, one value in m for each"
        " node; not needed for a simulated cell, whose truth is in the bag",
    )
    parser.add_argument(
        "--visibility",
        action="store_true",
        help="say of each of the 21 errors whether these lines determine it, what it is confounded"
        " with, and how certain it can be",
    )
    add_air_options(parser)
    add_correction_options(parser)
    add_result_options(parser, "NAME_results beside the bag")
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Solve the bag; see the module."""
    from stepdiag_ros.report.publish import results_folder

    report = report_of(
        arguments.bag,
        arguments.recorded_lines,
        arguments.truth,
        lambda measurement: corrected(measurement, arguments),
        arguments.visibility,
        arguments.run_id,
        air_choice(arguments),
    )
    return show_report(report, arguments, results_folder(arguments.bag))


def report_of(
    bag: Path,
    recorded_lines: bool = False,
    truth: Path | None = None,
    correct: "Callable[[Measurement], tuple[Measurement, tuple[str, ...]]] | None" = None,
    with_visibility: bool = False,
    run_id: str | None = None,
    air: "AirChoice | None" = None,
) -> "Report":
    """Solve a bag by every method.

    Args:
        bag: the file.
        recorded_lines: take the lines as recorded even where the bag has the readings.
        truth: file of known error curves; that of a simulated cell is in the bag.
        correct: returns a measurement corrected, and in words how; a result that was corrected is
            not compared with the recorded one.
        with_visibility: say of each error whether these lines tell it.
        run_id: which run, where the bag holds several.
        air: compensate the readings for the air anew; None: as it was done in the run.

    Raises:
        ValueError: the bag cannot be read or solved, or the truth does not fit; one sentence.
    """
    from stepdiag_ros.bags.run import load_run

    with progress_bar(f"reading {bag.name}") as progress:
        recorded = load_run(bag, run_id)
        return report_of_run(
            recorded, progress, recorded_lines, truth, correct, with_visibility, air
        )


def report_of_run(
    recorded: "RecordedRun",
    progress: Progress,
    recorded_lines: bool = False,
    truth: Path | None = None,
    correct: "Callable[[Measurement], tuple[Measurement, tuple[str, ...]]] | None" = None,
    with_visibility: bool = False,
    air: "AirChoice | None" = None,
) -> "Report":
    """Solve a run that was loaded, by every method; see ``report_of``.

    Args:
        recorded: the run.
        progress: told how far the reading has come.
        recorded_lines: see ``report_of``; so are the others.
        truth: likewise.
        correct: likewise.
        with_visibility: likewise.
        air: likewise.

    Raises:
        ValueError: the run cannot be solved, or the truth does not fit; one sentence.
    """
    from stepdiag_ros.report.build import build_report

    measured, remark = measurement_of(recorded, recorded_lines, progress, air)
    measurement, corrections = (measured, ()) if correct is None else correct(measured)
    name = recorded.machine.get("name", "")
    return build_report(
        measurement,
        run_id=recorded.run_id,
        plan=recorded.plan.name,
        machine=name if isinstance(name, str) else "",
        chain=recorded.chain,
        run_software_version=recorded.software_version,
        simulated=True if recorded.cell_text else None,
        truth=_truth(recorded, measurement, truth),
        bag=recorded.path,
        with_visibility=with_visibility,
        recorded=() if corrections or air else recorded.results,
        remarks=(
            remark,
            *corrections,
            *_target_corrections(recorded),
            *_out_of_step(recorded),
            *_diagnosed(recorded),
        ),
    )


def _target_corrections(recorded: "RecordedRun") -> tuple[str, ...]:
    """Say by what the bridge corrected targets in the run: the result is what that left."""
    said = {
        one.message: None
        for one in recorded.diagnostics
        if one.name.endswith(TARGET_CORRECTION) and one.level == _WARN
    }
    return tuple(f"in this run {words}: the errors are those that it left" for words in said)


def _out_of_step(recorded: "RecordedRun") -> tuple[str, ...]:
    """Say what the assembler has found to be wrong with the time stamps of the run."""
    said = {
        one.message: None
        for one in recorded.diagnostics
        if one.name.endswith("assembler: timing") and one.level == _WARN
    }
    return tuple(f"in this run {words}: stepdiag info BAG" for words in said)


def _diagnosed(recorded: "RecordedRun") -> tuple[str, ...]:
    """Say what the diagnosis beside the run came to, if there was one."""
    if not recorded.diagnoses:
        return ()
    last = recorded.diagnoses[-1]
    cut = "" if last.run_over else "the last before the recording ends, "
    return (f"diagnosis beside the run, {cut}{last.words} More: stepdiag diagnose BAG",)


def _truth(
    recorded: "RecordedRun", measurement: "Measurement", given: Path | None
) -> "Truth | None":
    from stepdiag_ros.configuration import cell_from_text, read_yaml
    from stepdiag_ros.report.build import truth_from_curves, truth_of

    lines = [line.line.name for line in measurement.lines]
    if given is not None:
        curves = read_yaml(given)
        if not isinstance(curves, dict):
            raise ValueError(f"{given}: expected error curves, for example 'E_XX: [0.0, 1.0e-7]'")
        try:
            return truth_from_curves(curves, measurement.volume, lines)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{given}: {error}") from None
    if not recorded.cell_text:
        return None
    cell = cell_from_text(recorded.cell_text, f"{recorded.path}: simulated cell")
    return truth_of(cell, measurement.volume, lines)


def measurement_of(
    recorded: "RecordedRun",
    recorded_lines: bool,
    progress: Progress,
    air: "AirChoice | None" = None,
) -> "tuple[Measurement, str]":
    """Return the lines of a run, and in words where they come from.

    Args:
        recorded: the run.
        recorded_lines: take the lines as recorded even where the bag has the readings.
        progress: told how far the reading has come.
        air: compensate the readings for the air anew; None: as it was done in the run.

    Raises:
        ValueError: they are to be compensated anew, and there is nothing to do it with.
    """
    from stepdiag_ros.metrology.assembly import assemble
    from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement, latest_attempts

    readings = _Counted(recorded, progress)
    if air is not None:
        return _compensated_anew(recorded, recorded_lines, readings, air)
    if recorded_lines or not recorded.commands:
        return recorded.measurement, "solved from the lines as recorded"
    events = assemble(
        recorded.plan, recorded.start_time, recorded.commands, recorded.arrivals, readings
    )
    if not readings.count:
        return recorded.measurement, "solved from the lines as recorded: the bag has no readings"
    lines = tuple(event for event in events if isinstance(event, MeasuredLine))
    if recorded.begun_late:
        return recorded.measurement, _late(recorded.lines, lines, readings.count)
    if _same_lines(lines, recorded.lines):
        comparison = "the same lines to the last bit as recorded"
    else:
        comparison = "NOT the same lines as recorded"
        say("stepdiag: warning: the lines assembled from the readings differ from those recorded")
    return (
        Measurement(recorded.volume, latest_attempts(lines), recorded.chain),
        f"assembled again from {readings.count} readings: {comparison}",
    )


def _compensated_anew(
    recorded: "RecordedRun", recorded_lines: bool, readings: "_Counted", air: "AirChoice"
) -> "tuple[Measurement, str]":
    """Return the lines of a run from its counts and its weather, and in words how."""
    from stepdiag_ros.metrology.air.recompensation import begins_of_setups, recompensated
    from stepdiag_ros.metrology.assembly import assemble
    from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement, latest_attempts

    if recorded_lines:
        raise ValueError("--air compensates readings: it cannot be used with --recorded-lines")
    if recorded.begun_late or not recorded.commands:
        raise ValueError(
            f"{recorded.path}: --air needs all commands and readings of the run, and the recording"
            " lacks some: solve it as it was compensated in the run"
        )
    weather = recorded.weather()
    if air.kind == "own" and not weather:
        raise ValueError(f"{recorded.path}: no weather sensor was recorded; --air own needs some")
    begins = begins_of_setups(recorded.commands, recorded.arrivals)
    events = assemble(
        recorded.plan,
        recorded.start_time,
        recorded.commands,
        recorded.arrivals,
        recompensated(readings, weather, begins, recorded.plan, air),
    )
    if not readings.count:
        raise ValueError(f"{recorded.path}: --air needs readings, and the bag has none")
    lines = tuple(event for event in events if isinstance(event, MeasuredLine))
    if not any(line.complete for line in lines):
        raise ValueError(
            f"{recorded.path}: no line is complete when its readings are compensated by --air"
            f" {air.kind}: is the count recorded, and was the weather known throughout the run?"
        )
    if air.kind == "off":
        how = "not compensated for the air: displacements are those of the count"
    else:
        how = (
            f"compensated anew for the recorded air: equation {air.equation}, dead path"
            f" {air.dead_path:g} m, wavelength {air.wavelength * 1e9:.4f} nm"
        )
    return (
        Measurement(recorded.volume, latest_attempts(lines), recorded.chain),
        f"assembled from {readings.count} readings, {how}",
    )


def _late(
    recorded: "tuple[MeasuredLine, ...]", assembled: "tuple[MeasuredLine, ...]", readings: int
) -> str:
    """Say what the readings of a recording that lacks the run's beginning confirm.

    A line that was measured before the recording began cannot be assembled again, nor can one that
    shares its zero with such a line.
    """
    same = sum(any(_same_lines((a,), (b,)) for b in assembled) for a in recorded)
    return (
        f"the recording began after the run did: solved from its {len(recorded)} lines as recorded;"
        f" {same} of them were assembled again from {readings} readings, the same to the last bit"
    )


def _same_lines(first: "tuple[MeasuredLine, ...]", second: "tuple[MeasuredLine, ...]") -> bool:
    """Say whether two runs of lines are the same in every bit of what a solver uses."""
    import numpy as np

    def numbers(line: "MeasuredLine") -> bytes:
        parts = (line.time, line.target, line.displacement, line.standard_uncertainty)
        # There are many bit patterns of NaN; all mean unknown.
        return b"".join(np.where(np.isnan(part), np.nan, part).tobytes() for part in parts)

    def words(line: "MeasuredLine") -> tuple[object, ...]:
        return line.line, line.line_index, line.attempt, line.setup

    return len(first) == len(second) and all(
        words(a) == words(b) and numbers(a) == numbers(b)
        for a, b in zip(first, second, strict=True)
    )


class _Counted:
    """The readings of a run, counted as they go by."""

    def __init__(self, recorded: "RecordedRun", progress: Progress) -> None:
        self.count = 0
        self._recorded = recorded
        self._progress = progress

    def __iter__(self) -> "Iterator[Reading]":
        from stepdiag_ros.bags.folder import open_bag

        with open_bag(self._recorded.path) as bag:
            start, end = bag.start_time, bag.end_time
        length = max(end - start, 1)
        for reading in self._recorded.readings():
            self.count += 1
            if self.count % _READINGS_BETWEEN_STEPS == 0:
                self._progress((reading.time - start) / length)
            yield reading
