"""``stepdiag diagnose``: compare a run with a model of the machine, and name what is missing."""

import io
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from stepdiag_ros.commands.arguments import (
    Command,
    Group,
    add_bag,
    add_common,
    picture_formats,
    results_folder,
)
from stepdiag_ros.commands.output import Progress, progress_bar, say, warn, warn_of_replaced
from stepdiag_ros.commands.standard_tests import (
    add_output_options,
    is_bag,
    refuse_for_table,
    show,
)
from stepdiag_ros.metrology.refusal import Refusal

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

    from stepdiag_ros.bags.run import RecordedRun
    from stepdiag_ros.evaluation.diagnosis import DiagnosisReport
    from stepdiag_ros.evaluation.history import ReadRun
    from stepdiag_ros.metrology.machine import Machine
    from stepdiag_ros.metrology.measurement import Measurement
    from stepdiag_ros.metrology.model import MachineModel
    from stepdiag_ros.metrology.plan import Plan

TOGETHER_DAYS = 7.0
"""Runs that start within this time of one another are one measurement."""
_MOST_DAYS = 3650.0
_EXAMPLES = """\
verdicts:
  CONSISTENT    the model explains the run to within its noise
  NAMED         what is missing, with size, uncertainty and what else was tried
  AMBIGUOUS     several effects close the gap; the run does not show which one
  DESCRIBED     no effect of the catalogue closes the gap, but a formula does
  UNEXPLAINED   neither closes the gap; where it is, and how large
  NOT TESTABLE  the run has no data that could contradict the model

examples:
  stepdiag diagnose run.mcap                     what do the curves leave?
  stepdiag diagnose run.csv --model mill.yaml    compared with a known model
  stepdiag diagnose run.mcap --extend mill.yaml  writes the extended model
  stepdiag diagnose later.mcap --model mill.yaml does it still hold?
  stepdiag diagnose run.mcap --propose more.yaml writes a short extra plan
  stepdiag run --plan more.yaml                  measures it
  stepdiag diagnose run.mcap more.mcap           both runs together
  stepdiag diagnose may.mcap june.mcap july.mcap  what stays, grows, comes and goes"""


def _add_options(parser: ArgumentParser) -> None:
    add_bag(parser, "a bag (.mcap) or run table (.csv)")
    add_common(parser, "run")
    parser.add_argument(
        "further",
        type=Path,
        nargs="*",
        metavar="FURTHER",
        help="further runs of the same machine over the same box, in any order. Runs that start"
        " within --together of one another are diagnosed as one: error curves and effects are"
        " shared, alignments, zeros and the lengths of the axes are not; times count from the start"
        " of each run. Of runs at different times, each keeps curves of its own, and the command"
        " reports which effects are in all runs, grow, or come and go",
    )
    parser.add_argument(
        "--together",
        type=_days,
        default=TOGETHER_DAYS,
        metavar="DAYS",
        help="time within which runs are one measurement (default: %(default)g; 0: each run is"
        " one of its own)",
    )
    parser.add_argument(
        "--model",
        metavar="MODEL",
        help="model of the machine (YAML: chain, curves, effects), by path or name"
        " (default: all error curves free, no further effects)",
    )
    parser.add_argument(
        "--extend",
        type=Path,
        metavar="NEW_MODEL",
        help="write the model with the named effects added (YAML), and diagnose again under it",
    )
    parser.add_argument(
        "--status",
        choices=("fixed", "fitted"),
        default="fitted",
        help="status of the effects that --extend adds: fitted: determined again from every later"
        " run (default); fixed: keep the size",
    )
    parser.add_argument(
        "--propose",
        type=Path,
        metavar="PLAN",
        help="where several effects or formulas may be the cause: write a short extra plan (YAML)"
        " that distinguishes them, with the run's own box, feed and dwell",
    )
    add_common(
        parser, "seed", help="seed of the random draws that guard against false names (default: 0)"
    )
    add_output_options(parser, "NAME_diagnosis beside the bag")


def _days(text: str) -> float:
    days = float(text)
    if not 0.0 <= days <= _MOST_DAYS:
        raise ArgumentTypeError(f"{text} is not a number of days from 0 to {_MOST_DAYS:g}")
    return days


def run(arguments: Namespace) -> int:
    """Diagnose; see the module."""
    from stepdiag_ros.report.documents.diagnosis import diagnosis_json
    from stepdiag_ros.report.files import check_new
    from stepdiag_ros.report.publish import DIAGNOSIS_PICTURES, write_results
    from stepdiag_ros.report.tables.diagnosis import print_diagnosis
    from stepdiag_ros.text.console import make_console

    new = (path for path in (arguments.extend, arguments.propose) if path is not None)
    check_new(new, remedy="name another file")
    recorded = _loaded(arguments.bag, arguments.run_id)
    folder = arguments.output or results_folder(arguments.bag, "diagnosis")
    if recorded is not None and recorded.plan.tracker is not None:
        return _show_tracker(recorded, arguments, folder)
    runs = _runs(arguments, recorded)
    groups = _apart(arguments, runs)
    if len(groups) > 1:
        return _show_history(groups, arguments, folder)
    report = report_of(arguments, runs)
    if arguments.extend is not None:
        report = _written(report, arguments.extend)
    if arguments.propose is not None:
        report = _plan_written(report, arguments)
    formats = picture_formats(arguments)
    document = diagnosis_json(report)
    text = io.StringIO()
    print_diagnosis(report, make_console(text))
    contents = {"diagnosis.json": document + "\n", "diagnosis.txt": text.getvalue()}
    warn_of_replaced(folder / "diagnosis.json", report.run_id)
    with progress_bar("writing results") as progress:
        pictures: Mapping[str, Picture | bytes] = {}
        if formats:
            from stepdiag_ros.plots.files.diagnosis import draw_diagnosis
            from stepdiag_ros.plots.saving import png_bytes
            from stepdiag_ros.report.pages.diagnosis import diagnosis_page

            figures = draw_diagnosis(report)
            shown = {name: png_bytes(figure) for name, figure in figures.items()}
            contents["diagnosis.html"] = diagnosis_page(report, shown)
            pictures = shown if formats == ("png",) else figures
        files = write_results(
            folder, contents, lambda: pictures, formats, progress, DIAGNOSIS_PICTURES
        )
    if arguments.json:
        print(document)
    else:
        print_diagnosis(report, make_console(sys.stdout))
    say(f"results in {folder}: {', '.join(path.name for path in files)}")
    if arguments.extend is not None and report.extended_path is None:
        say(
            f"stepdiag: {arguments.extend} was not written: the verdict is"
            f" {report.diagnosis.verdict}, and only what was NAMED or DESCRIBED goes into a model"
        )
    if arguments.propose is not None and report.proposal_path is None:
        why = "" if report.proposal is None else f": {report.proposal.sentence}"
        say(f"stepdiag: {arguments.propose} was not written{why}")
    return 0


def _loaded(path: Path, run_id: str | None) -> "RecordedRun | None":
    """Load a bag; None of a table. Of several runs in it the one that is named."""
    refuse_for_table(path, {"--run": run_id})
    if not is_bag(path):
        return None
    from stepdiag_ros.bags.run import load_run

    with progress_bar(f"reading {path.name}"):
        return load_run(path, run_id)


def _show_tracker(recorded: "RecordedRun", arguments: Namespace, folder: Path) -> int:
    """Show the verdict on a run with a tracker, which compares its passes with each other.

    Raises:
        ValueError: an option was given that such a run has no use for.
    """
    from stepdiag_ros.commands.tracker_evaluate import show_run

    for option in ("further", "model", "extend", "propose"):
        if getattr(arguments, option):
            what = "a further bag" if option == "further" else f"--{option}"
            raise ValueError(
                f"{recorded.path} was measured with a tracker, whose passes are compared with each"
                f" other: leave out {what}"
            )
    return show_run(recorded, arguments, folder)


def report_of(arguments: Namespace, runs: "Sequence[_Run] | None" = None) -> "DiagnosisReport":
    """Compare one run, or several that were made together, with the model.

    Args:
        arguments: parsed.
        runs: that the arguments name, if they are read already.

    Raises:
        ValueError: run or model cannot be read, or they contradict each other; one sentence.
    """
    from stepdiag_ros.evaluation.diagnosis import Ask, build_diagnosis
    from stepdiag_ros.metrology.discrepancy.joint import joined
    from stepdiag_ros.metrology.effects import catalogue
    from stepdiag_ros.text.intake import refusals_of

    model, source = _model(arguments)
    runs = _runs(arguments) if runs is None else runs
    # Outside the refusals of the bag: a broken effect is not the fault of the bag.
    known = catalogue()
    first = runs[0]
    measurement = first.measurement
    if len(runs) > 1:
        measurement = joined([run.measurement for run in runs], [str(run.path) for run in runs])
    with progress_bar("comparing") as progress, refusals_of(arguments.bag):
        return build_diagnosis(
            measurement,
            model,
            known,
            bag=arguments.bag,
            date=datetime.now(timezone.utc).date().isoformat(),
            run_id=first.run_id,
            model_source=source,
            status=arguments.status,
            again=arguments.extend is not None,
            seed=arguments.seed,
            tell=lambda text: progress(0.5, text),
            remarks=tuple(remark for run in runs for remark in run.remarks),
            further=[(run.path, run.run_id) for run in runs[1:]],
            ask=Ask(first.conditions, first.machine) if arguments.propose is not None else None,
        )


def _model(arguments: Namespace) -> "tuple[MachineModel, str]":
    """Return the model that the user named, and its name; without one all curves are free."""
    from stepdiag_ros.metrology.model import MachineModel

    if arguments.model is None:
        return MachineModel(), ""
    from stepdiag_ros.configuration import load_model

    return load_model(arguments.model)[0], str(arguments.model)


def _runs(arguments: Namespace, recorded: "RecordedRun | None" = None) -> "list[_Run]":
    """Read all runs that the user named.

    Args:
        arguments: parsed.
        recorded: the first run, if it is loaded already.
    """
    runs: list[_Run] = []
    paths = [arguments.bag, *arguments.further]
    for path, run_id in zip(paths, (arguments.run_id, *(None for _ in paths)), strict=False):
        loaded = recorded if recorded is not None and not runs else _loaded(path, run_id)
        with progress_bar(f"reading {path.name}") as progress:
            runs.append(_run_of(path, loaded, progress))
        if loaded is not None and len(paths) > 1:
            _warn_if_incomplete(path, loaded, runs[-1].measurement)
    return runs


def _apart(arguments: Namespace, runs: "Sequence[_Run]") -> "list[list[ReadRun]]":
    """Part runs that were not made together; see ``evaluation.history.apart``."""
    if len(runs) == 1:
        return []
    from stepdiag_ros.bags.digest import sha256_of
    from stepdiag_ros.evaluation.diagnosis import RunFile
    from stepdiag_ros.evaluation.history import ReadRun, apart

    read = [
        ReadRun(
            RunFile(run.path, sha256_of(run.path), run.run_id),
            run.measurement,
            run.start,
            run.facts,
        )
        for run in runs
    ]
    return apart(read, arguments.together)


def _show_history(groups: "Sequence[Sequence[ReadRun]]", arguments: Namespace, folder: Path) -> int:
    """Show what becomes of every effect from run to run.

    Raises:
        ValueError: an option was given that belongs to a diagnosis of runs as one.
    """
    from stepdiag_ros.evaluation.history import build_history
    from stepdiag_ros.metrology.effects import catalogue
    from stepdiag_ros.report.documents.history import history_json
    from stepdiag_ros.report.tables.history import print_history

    for option in ("extend", "propose"):
        if getattr(arguments, option) is not None:
            raise ValueError(
                f"--{option} belongs to runs that were made together, and these were made at"
                f" {len(groups)} different times: leave it out, or name the runs of one time"
            )
    model, source = _model(arguments)
    with progress_bar("comparing") as progress:
        report = build_history(
            groups,
            model,
            catalogue(),
            model_source=source,
            seed=arguments.seed,
            progress=progress,
        )

    def draw() -> "Mapping[str, Picture]":
        from stepdiag_ros.plots.history import sizes_over_dates

        drawn = sizes_over_dates(report)
        return {} if drawn is None else {"history": drawn}

    return show(
        "history",
        history_json(report),
        lambda console: print_history(report, console),
        draw,
        arguments,
        folder,
    )


class _Run(NamedTuple):
    """A run as it was read.

    Attributes:
        path: of the file.
        measurement: its lines.
        run_id: its identity; empty if it has none.
        start: when it began, ns since 1970; 0 if not known.
        facts: what is stated of the machine in words, such as its name: what → text.
        remarks: where the lines come from, in words.
        conditions: its plan, if the plan states the feed.
        machine: that measured it; None if unknown.
    """

    path: Path
    measurement: "Measurement"
    run_id: str = ""
    start: int = 0
    facts: Mapping[str, str] = {}  # never changed
    remarks: tuple[str, ...] = ()
    conditions: "Plan | None" = None
    machine: "Machine | None" = None


def _run_of(path: Path, recorded: "RecordedRun | None", progress: Progress) -> _Run:
    """Return the lines of a bag that was loaded, or of a table."""
    if recorded is None:
        from stepdiag_ros.bags.table import load_table

        return _Run(path, load_table(path).measurement)
    from stepdiag_ros.configuration import machine_if_described
    from stepdiag_ros.evaluation.history import machine_facts
    from stepdiag_ros.evaluation.recorded_run import measurement_of, require_standing_beam

    require_standing_beam(recorded)
    measurement, remark = measurement_of(recorded, False, progress, warn=warn)
    if not measurement.lines:
        raise Refusal(
            f"{path} is incomplete: no line of this run was finished. Leave it out or delete it, or"
            " give the next run another folder with --output",
            fault="too_few",
        )
    machine = machine_if_described(recorded.machine_text, f"{path}: machine")
    known = recorded.plan.feed > 0.0 and machine is not None
    return _Run(
        path,
        measurement,
        recorded.run_id,
        recorded.start_time,
        machine_facts(recorded),
        (remark,),
        recorded.plan if known else None,
        machine if known else None,
    )


def _warn_if_incomplete(path: Path, recorded: "RecordedRun", measurement: "Measurement") -> None:
    """Warn of a run that was stopped, where several are compared together."""
    from stepdiag_ros.bags.passes import completeness_of

    passes = completeness_of(recorded, measurement)
    if not passes.whole:
        warn(
            f"{path} is incomplete: {passes.complete} of {passes.planned} passes. If that run was"
            " stopped, leave the bag out or delete it"
        )


def _plan_written(report: "DiagnosisReport", arguments: Namespace) -> "DiagnosisReport":
    """Write the extra plan, if there is one."""
    from stepdiag_ros.planning.separation import proposal_text
    from stepdiag_ros.report.files import whole_file

    if report.proposal is None or report.proposal.plan is None:
        return report
    names = " ".join(path.name for path in (arguments.bag, *arguments.further))
    text = proposal_text(report.proposal, names)
    with whole_file(arguments.propose) as partial:
        partial.write_text(text, encoding="utf-8")
    return replace(report, proposal_path=arguments.propose)


def _written(report: "DiagnosisReport", path: Path) -> "DiagnosisReport":
    """Write the extended model, if there is one."""
    import yaml

    from stepdiag_ros.report.files import whole_file

    if report.extended is None:
        return report
    # A model without a name gets that of its file.
    extended = replace(report.extended, name=report.extended.name or path.stem)
    text = yaml.safe_dump(extended.to_mapping(), sort_keys=False, allow_unicode=True)
    with whole_file(path) as partial:
        partial.write_text(text, encoding="utf-8")
    return replace(report, extended=extended, extended_path=path)


COMMAND = Command(
    "diagnose",
    Group.UNDERSTAND,
    20,
    _add_options,
    run,
    help="compare a run with a model and name the missing effect",
    description="Compare a recorded run with a model of the machine. The command reports whether"
    " they agree, and if not, where the gap is and which effect of the catalogue closes it, with"
    " size, uncertainty and a proof on data that took no part in the fit. The noise is estimated"
    " from the repeats. Every verdict is a result: the exit code is 0.",
    epilog=_EXAMPLES,
)
