"""From a recorded run to its lines and its results: for a command, a notebook and a page alike."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from stepdiag_ros.bags.passes import completeness_of
from stepdiag_ros.bags.run import RecordedRun
from stepdiag_ros.bags.tally import Flaw
from stepdiag_ros.configuration import cell_from_text, read_yaml
from stepdiag_ros.evaluation.build import build_report, truth_from_curves, truth_of
from stepdiag_ros.evaluation.decision import lead_of_results
from stepdiag_ros.evaluation.diagnosing import verdict_on
from stepdiag_ros.evaluation.pursuit import pursuit_from_text, standing
from stepdiag_ros.evaluation.report import Report, Truth
from stepdiag_ros.metrology.air.recompensation import AirChoice, begins_of_setups, recompensated
from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.direct import DirectMeasurement
from stepdiag_ros.metrology.measurement import MeasuredLine, Measurement, Reading, latest_attempts
from stepdiag_ros.metrology.plausible import ROTATIONS_KEY
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.solvers import solvers
from stepdiag_ros.metrology.solvers.limits import DIAGNOSIS, VISIBILITY, left_out, left_out_sentence
from stepdiag_ros.metrology.solvers.result import VolumetricErrors
from stepdiag_ros.metrology.target import TargetStanding
from stepdiag_ros.text.intake import refusals_of

Correct = Callable[[Measurement], tuple[Measurement, tuple[str, ...]]]
"""Returns a measurement corrected, and in words how."""
TARGET_CORRECTION = "target correction"
"""End of the name under which the bridge reports target correction on /diagnostics."""
_WARN = 1


def silent(_: object) -> None:
    """Ignore the progress."""


def report_of_run(
    recorded: RecordedRun,
    progress: Callable[[float], None] = silent,
    recorded_lines: bool = False,
    truth: Path | None = None,
    correct: Correct | None = None,
    with_visibility: bool = False,
    air: AirChoice | None = None,
    warn: Callable[[str], None] = silent,
    with_verdict: bool = False,
    direct: DirectMeasurement | None = None,
    rotation: float | None = None,
    further: tuple[str, ...] = (),
) -> Report:
    """Solve a run that was loaded, by every method.

    Args:
        recorded: the run.
        progress: called with the part that has been read, 0..1.
        recorded_lines: take the lines as recorded even where the bag has the readings.
        truth: file of known error curves; that of a simulated cell is in the bag.
        correct: returns a measurement corrected, and in words how; a result that was corrected is
            not compared with the recorded one.
        with_visibility: state for each error whether these lines determine it.
        air: compensate the readings for the air again; None: as it was done in the run.
        warn: called with a sentence if the lines differ from the recorded ones, and before
            solving if parts of a very large run are left out.
        with_verdict: diagnose the lines that are solved.
        direct: errors that were measured directly, weighed in; a result with them is not compared
            with the recorded one, which was made without.
        rotation: plausible size of the axes' rotations, rad; None: as the machine's file states.
        further: evaluations that are to follow, named too where they will be left out.

    Raises:
        ValueError: the run cannot be solved, or the true errors do not fit; one sentence.
    """
    require_standing_beam(recorded)
    with refusals_of(recorded.path):
        return _report_of_run(
            *(recorded, progress, recorded_lines, truth, correct, with_visibility, air, warn),
            *(with_verdict, direct, rotation, further),
        )


def _report_of_run(
    recorded: RecordedRun,
    progress: Callable[[float], None],
    recorded_lines: bool,
    truth: Path | None,
    correct: Correct | None,
    with_visibility: bool,
    air: AirChoice | None,
    warn: Callable[[str], None],
    with_verdict: bool,
    direct: DirectMeasurement | None,
    rotation: float | None,
    further: tuple[str, ...],
) -> Report:
    measured, remark, flaws = _measured(recorded, recorded_lines, progress, air, warn)
    measurement, corrections = (measured, ()) if correct is None else correct(measured)
    measurement = replace(measurement, direct=direct)
    if rotation is not None:
        plausible = replace(measurement.plausible, rotation=rotation)
        measurement = replace(measurement, plausible=plausible)
    name = recorded.machine.get("name", "")
    blocks, stops = measurement.volume.blocks, measurement.stop_count
    asked = (*solvers(), *further)
    asked += (DIAGNOSIS,) * with_verdict + (VISIBILITY,) * with_visibility
    sentence = left_out_sentence(blocks, stops, asked)
    if sentence:
        warn(sentence)
    report = build_report(
        measurement,
        run_id=recorded.run_id,
        plan=recorded.plan.name,
        machine=name if isinstance(name, str) else "",
        chain=recorded.chain,
        run_software_version=recorded.software_version,
        simulated=True if recorded.simulated_cell else None,
        truth=_truth(recorded, measurement, truth, corrected=bool(corrections)),
        bag=recorded.path,
        with_visibility=with_visibility and VISIBILITY not in left_out(blocks),
        recorded=() if corrections or air or direct or rotation is not None else recorded.results,
        remarks=(
            remark,
            *corrections,
            *direct_origin(direct),
            *_target_corrections(recorded),
            *out_of_step(recorded),
            *diagnosed(recorded),
            *((sentence,) if sentence else ()),
        ),
        passes=completeness_of(recorded, measurement),
        recording=flaws,
    )
    report = replace(
        report,
        target=target_standing(recorded, measurement, report.results),
        routine=(remark, *diagnosed(recorded)),
        rotation_stated=rotation is not None or ROTATIONS_KEY in recorded.machine,
    )
    return judged(report) if with_verdict else report


def judged(report: Report) -> Report:
    """Return a report with the verdict of a diagnosis of its lines."""
    assert report.measurement is not None
    return replace(report, verdict=verdict_on(report.measurement))


def target_standing(
    recorded: RecordedRun, measurement: Measurement, results: Iterable[VolumetricErrors]
) -> TargetStanding | None:
    """Return how far a recorded run has come to its target, computed from its lines.

    Args:
        recorded: the run.
        measurement: its lines.
        results: of these lines, by every method.

    Returns:
        None if the run has no target.
    """
    pursuit = pursuit_from_text(recorded.until, recorded.plan, recorded.machine_text)
    if pursuit is None or not measurement.lines:
        return None
    found = {one.method: one for one in results}
    lead = lead_of_results(found, measurement, completeness_of(recorded, measurement))
    return standing(pursuit, measurement, found, lead)


def require_standing_beam(recorded: RecordedRun) -> None:
    """Refuse a run with a tracker where lines along a standing beam are needed.

    Raises:
        ValueError: names the bag and what evaluates it.
    """
    if recorded.plan.tracker is not None:
        raise Refusal(
            f"{recorded.path} was measured with a tracker: its results are those of 'stepdiag"
            f" tracker evaluate {recorded.path.name}'",
            fault="wrong_kind",
        )


def _target_corrections(recorded: RecordedRun) -> tuple[str, ...]:
    """Say by what the bridge corrected targets in the run: the result is what that left."""
    said = {
        one.message: None
        for one in recorded.diagnostics
        if one.name.endswith(TARGET_CORRECTION) and one.level == _WARN
    }
    return tuple(f"in this run {words}: the errors are those that it left" for words in said)


def direct_origin(direct: DirectMeasurement | None) -> tuple[str, ...]:
    """Say which errors were measured directly, and in which files they are."""
    return tuple(
        f"{', '.join(file.errors)} measured directly: {file.name}, SHA-256 {file.sha256}"
        for file in (() if direct is None else direct.files)
    )


def out_of_step(recorded: RecordedRun) -> tuple[str, ...]:
    """Say what the assembler has found to be wrong with the time stamps of the run."""
    said = {
        one.message: None
        for one in recorded.diagnostics
        if one.name.endswith("assembler: timing") and one.level == _WARN
    }
    return tuple(f"in this run {words}: stepdiag info BAG" for words in said)


def diagnosed(recorded: RecordedRun) -> tuple[str, ...]:
    """Say what the diagnosis beside the run came to, if there was one."""
    if not recorded.diagnoses:
        return ()
    last = recorded.diagnoses[-1]
    cut = "" if last.run_over else "the last before the recording ends, "
    return (f"diagnosis beside the run, {cut}{last.words} More: stepdiag diagnose BAG",)


def _truth(
    recorded: RecordedRun, measurement: Measurement, given: Path | None, *, corrected: bool
) -> Truth | None:
    """Return the true errors; None where they are not known.

    Those of a simulated cell are not what corrected targets leave, or what is corrected to 20 °C.
    """
    lines = [line.line.name for line in measurement.lines]
    if given is not None:
        curves = read_yaml(given)
        if not isinstance(curves, dict):
            raise ValueError(f"{given}: expected error curves, for example 'E_XX: [0.0, 1.0e-7]'")
        try:
            return truth_from_curves(curves, measurement.volume, lines)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{given}: {error}") from None
    if not recorded.cell_text or corrected or _target_corrections(recorded):
        return None
    cell = cell_from_text(recorded.cell_text, f"{recorded.path}: simulated cell")
    return truth_of(cell, measurement.volume, lines)


def measurement_of(
    recorded: RecordedRun,
    recorded_lines: bool = False,
    progress: Callable[[float], None] = silent,
    air: AirChoice | None = None,
    warn: Callable[[str], None] = silent,
) -> tuple[Measurement, str]:
    """Return the lines of a run, and in words where they come from.

    Args:
        recorded: the run.
        recorded_lines: take the lines as recorded even where the bag has the readings.
        progress: called with the part that has been read, 0..1.
        air: compensate the readings for the air again; None: as it was done in the run.
        warn: called with a sentence if the lines differ from the recorded ones.

    Raises:
        ValueError: they are to be compensated again, and there is nothing to do it with.
    """
    with refusals_of(recorded.path):
        return _measured(recorded, recorded_lines, progress, air, warn)[:2]


def _measured(
    recorded: RecordedRun,
    recorded_lines: bool,
    progress: Callable[[float], None],
    air: AirChoice | None,
    warn: Callable[[str], None],
) -> tuple[Measurement, str, tuple[Flaw, ...]]:
    """Return lines, words on them, and what is wrong with the recording; see ``measurement_of``."""
    flaws = recorded.flaws
    for flaw in flaws:
        warn(flaw.sentence)
    readings = _Counted(recorded, progress)
    if air is not None:
        return (*_compensated_anew(recorded, recorded_lines, readings, air), flaws)
    if recorded_lines or not recorded.commands:
        return recorded.measurement, "solved from the lines as recorded", flaws
    events = assemble(
        recorded.plan,
        recorded.start_time,
        recorded.commands,
        recorded.arrivals,
        readings,
        recorded.positions(),
    )
    if not readings.count:
        words = "solved from the lines as recorded: the bag has no readings"
        return recorded.measurement, words, flaws
    lines = tuple(event for event in events if isinstance(event, MeasuredLine))
    if recorded.begun_late:
        return recorded.measurement, _late(recorded.lines, lines, readings.count), flaws
    if _same_lines(lines, recorded.lines):
        comparison = "the lines are bit-identical to the recorded ones"
    else:
        comparison = "NOT the same lines as recorded"
        differs = (
            f"{recorded.path}: the lines assembled from the readings differ from those recorded"
        )
        flaws = (*flaws, Flaw("different", f"{differs}."))
        warn(differs)
    return (
        replace(recorded.measurement, lines=latest_attempts(lines)),
        f"assembled again from {readings.count} readings: {comparison}",
        flaws,
    )


def _compensated_anew(
    recorded: RecordedRun, recorded_lines: bool, readings: "_Counted", air: AirChoice
) -> tuple[Measurement, str]:
    """Return the lines of a run from its counts and its weather, and in words how."""
    if recorded_lines:
        raise Refusal(
            "--air compensates readings: it cannot be used with --recorded-lines", fault="mismatch"
        )
    if recorded.begun_late or not recorded.commands:
        raise Refusal(
            f"{recorded.path}: --air needs all commands and readings of the run, and the recording"
            " lacks some: solve it as it was compensated in the run",
            fault="too_few",
        )
    weather = recorded.weather()
    if air.kind == "own" and not weather:
        raise Refusal(
            f"{recorded.path}: no weather sensor was recorded; --air own needs some",
            fault="missing",
        )
    begins = begins_of_setups(recorded.commands, recorded.arrivals)
    events = assemble(
        recorded.plan,
        recorded.start_time,
        recorded.commands,
        recorded.arrivals,
        recompensated(readings, weather, begins, recorded.plan, air),
        recorded.positions(),
    )
    if not readings.count:
        raise ValueError(f"{recorded.path}: --air needs readings, and the bag has none")
    lines = tuple(event for event in events if isinstance(event, MeasuredLine))
    if not any(line.complete for line in lines):
        raise ValueError(
            f"{recorded.path}: no line is complete when its readings are compensated by --air"
            f" {air.kind}: check that the bag has the count, and the weather throughout the run"
        )
    if air.kind == "off":
        how = "not compensated for the air: displacements are those of the count"
    else:
        how = (
            f"compensated again for the recorded air: equation {air.equation}, dead path"
            f" {air.dead_path:g} m, wavelength {air.wavelength * 1e9:.4f} nm"
        )
    return (
        replace(recorded.measurement, lines=latest_attempts(lines)),
        f"assembled from {readings.count} readings, {how}",
    )


def _late(
    recorded: tuple[MeasuredLine, ...], assembled: tuple[MeasuredLine, ...], readings: int
) -> str:
    """Say what the readings of a recording that lacks the run's beginning confirm.

    A line that was measured before the recording began cannot be assembled again, nor can one that
    shares its zero with such a line.
    """
    same = sum(any(_same_lines((a,), (b,)) for b in assembled) for a in recorded)
    return (
        f"the recording began after the run: solved from its {len(recorded)} lines as recorded;"
        f" {same} of them were assembled again from {readings} readings and are bit-identical"
    )


def _same_lines(first: tuple[MeasuredLine, ...], second: tuple[MeasuredLine, ...]) -> bool:
    """Say whether two runs of lines are the same in every bit of what a solver uses."""

    def numbers(line: MeasuredLine) -> bytes:
        parts = (line.time, line.target, line.displacement, line.standard_uncertainty)
        # There are many bit patterns of NaN; all mean unknown.
        return b"".join(np.where(np.isnan(part), np.nan, part).tobytes() for part in parts)

    def words(line: MeasuredLine) -> tuple[object, ...]:
        return line.line, line.line_index, line.attempt, line.setup

    return len(first) == len(second) and all(
        words(a) == words(b) and numbers(a) == numbers(b)
        for a, b in zip(first, second, strict=True)
    )


class _Counted:
    """The readings of a run, counted as they go by."""

    def __init__(self, recorded: RecordedRun, progress: Callable[[float], None]) -> None:
        self.count = 0
        self._recorded = recorded
        self._progress = progress

    def __iter__(self) -> Iterator[Reading]:
        start, end = self._recorded.bag.start_time, self._recorded.bag.end_time
        length = max(end - start, 1)
        for batch in self._recorded.reading_batches():
            self.count += len(batch.time)
            # The bag's times are of receiving; a first reading was measured before its own.
            self._progress(max(int(batch.time[-1]) - start, 0) / length)
            yield from batch
