"""``stepdiag measure``: a run on nodes that are there already, started by others."""

import math
import sys
from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from stepdiag_ros import schemas
from stepdiag_ros.commands.arguments import Command, Group, add_common
from stepdiag_ros.commands.output import progress_bar, say, warn_of_undetermined
from stepdiag_ros.commands.until import RunTeller, add_until, until_of

if TYPE_CHECKING:
    from stepdiag_ros.evaluation.lead import RunLead
    from stepdiag_ros.processes.following import RunOutcome
    from stepdiag_ros.run.sequence import State


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--plan", default="", help="YAML file, or a name (default: the plan of the sequencer)"
    )
    add_until(parser)
    add_common(parser, "namespace")
    add_common(parser, "json", help="print the outcome of the run as JSON")


def run(arguments: Namespace) -> int:
    """Measure and say what came of it; see the module."""
    from stepdiag_ros import configuration
    from stepdiag_ros.processes.following import RunFailed
    from stepdiag_ros.processes.joining import JoinedRun

    # Read and checked here: what is executed is what the user sees, wherever the sequencer runs.
    text, until = "", until_of(arguments)
    if arguments.plan:
        plan, text = configuration.load_plan(arguments.plan)
        warn_of_undetermined(plan)
    with progress_bar("") as progress:
        tell = RunTeller(progress, say)
        # What was given is warned of already.
        on_plan = None if text else _warn_beside
        joined = JoinedRun(arguments.namespace, tell, _Attendant(arguments.namespace), on_plan)
        try:
            joined.measure(text, until)
        finally:
            if joined.measured is not None:
                _show(joined.measured, arguments.json)
    if joined.measured is not None and not joined.measured.bag_closed:
        raise RunFailed(f"the bag is not whole: {joined.measured.bag_text}")
    return 0


def _warn_beside(text: str) -> None:
    """Warn of what the lines of the sequencer's own plan do not determine.

    In a thread of its own: who follows a run must not fall silent.
    """
    from threading import Thread

    from stepdiag_ros.configuration import plan_from_text

    plan = plan_from_text(text, "the plan of the run")
    Thread(target=warn_of_undetermined, args=(plan,), daemon=True).start()


class _Attendant:
    """The user at the terminal, if there is a terminal.

    Args:
        namespace: of the nodes; empty for none.
    """

    def __init__(self, namespace: str) -> None:
        self._said = ""
        self._resume = "stepdiag resume" + (f" --namespace {namespace}" if namespace else "")

    def __call__(self, state: "State", text: str) -> bool:
        """Say why the run is held, and whether it is to go on."""
        from stepdiag_ros.processes.following import RunFailed
        from stepdiag_ros.run.sequence import State

        attended = sys.stdin is not None and sys.stdin.isatty()
        if state is State.FAULT and not attended:
            raise RunFailed(f"the run has stopped: {text}", fault="stopped")
        news = f"{state.name} {text}"
        if news != self._said:
            self._said = news
            if attended:
                _forget_typed()
                say(f"{text}: Enter goes on, Ctrl-C ends the run")
            else:
                say(f"{text}: '{self._resume}' or the service sequencer/resume goes on")
            return False
        if attended and _enter_was_pressed():
            self._said = ""
            return True
        return False


def _forget_typed() -> None:
    """Forget what was typed before: only who has read why the machine stands may start it."""
    import termios

    termios.tcflush(sys.stdin, termios.TCIFLUSH)


def _enter_was_pressed() -> bool:
    import select

    ready, _, _ = select.select([sys.stdin], [], [], 0.0)
    return bool(ready and sys.stdin.readline())


def _lead(measured: "RunOutcome") -> "RunLead":
    """Return the summary of the run, with the largest error as the solver published it."""
    from stepdiag_ros.bags.passes import Completeness
    from stepdiag_ros.evaluation.lead import RunLead
    from stepdiag_ros.metrology.discrepancy.summary import NOT_DIAGNOSED, Verdict
    from stepdiag_ros.metrology.standards.volumetric import VolumetricAccuracy
    from stepdiag_ros.run.conclusion import UNKNOWN

    known = math.isfinite(measured.largest_error)
    nowhere = (math.nan, math.nan, math.nan)
    largest = VolumetricAccuracy(measured.largest_error, measured.largest_at, nowhere)
    name = NOT_DIAGNOSED if measured.verdict == UNKNOWN else measured.verdict
    # The name of a tracker's line has a colon in it too, and no space behind that.
    missing = tuple(line.partition(": ")[0] for line in measured.incomplete)
    return RunLead(
        Verdict(name, measured.sentence),
        Completeness(
            *(measured.stops_asked_for, measured.stops_done, missing, measured.text), unit="stops"
        ),
        measured.bag,
        target=measured.standing,
        unknown=measured.not_determined,
        volume=largest if known else None,
        expanded_uncertainty=measured.expanded_uncertainty,
        budgeted=measured.budgeted,
        # Nobody states laser, air and setup to a live run.
        lower_bound=measured.budgeted,
    )


def _show(measured: "RunOutcome", as_json: bool) -> None:
    from stepdiag_ros.report.documents.lead import lead_document
    from stepdiag_ros.schemas.measurement import Document
    from stepdiag_ros.schemas.parts import part_of
    from stepdiag_ros.words.lead import next_lines, sentences_of

    lead = _lead(measured)
    bag = None if measured.bag is None else str(measured.bag)
    if as_json:
        document = part_of(
            Document,
            measured,
            outcome=measured.outcome.name.lower(),
            incomplete=list(measured.incomplete),
            bag=bag,
            lead=lead_document(lead),
        )
        print(schemas.json_text(schemas.document("measurement", document)))
        return
    print(f"run:     {measured.run_id}")
    print(f"outcome: {measured.text} ({measured.stops_done} of {measured.stops_total} stops)")
    for line in measured.incomplete:
        print(f"left:    {line}")
    print(f"bag:     {bag or 'unknown'} ({measured.bag_text})")
    for line in ("", "In short:", *sentences_of(lead), *next_lines(lead)):
        print(line)


COMMAND = Command(
    "measure",
    Group.MEASURE,
    40,
    _add_options,
    run,
    help="run a test plan on nodes that are already running",
    description="Start a run on the nodes in the ROS graph, by the sequencer's action, and follow"
    " it until it is recorded and evaluated. If the run waits for a setup or was stopped by a"
    " fault, the command reports it: press Enter to continue once everything is in order. Without"
    " a terminal, a fault ends the run, and 'stepdiag resume' confirms a setup. Ctrl-C stops the"
    " machine and ends the run. The exit code is 0 if all lines were measured and the"
    " bag is whole, 1 if not, 130 after Ctrl-C, 143 after SIGTERM.",
    epilog="examples:\n"
    "  stepdiag measure                        plan of the sequencer\n"
    "  stepdiag measure --plan my_plan.yaml    another plan, in a file on this computer",
)
