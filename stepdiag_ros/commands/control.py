"""``stepdiag pause``, ``resume`` and ``abort``: a run that somebody else has started."""

from argparse import ArgumentParser, Namespace
from functools import partial

from stepdiag_ros.commands.arguments import Command, Group, add_common


def _add_options(parser: ArgumentParser) -> None:
    add_common(parser, "namespace")


def run(service: str, arguments: Namespace) -> int:
    """Call one service of the sequencer and print its answer; see the module."""
    from stepdiag_ros.processes.joining import asked_of_sequencer

    print(asked_of_sequencer(service, arguments.namespace))
    return 0


def _command(order: int, service: str, what: str, meaning: str) -> Command:
    return Command(
        service,
        Group.MEASURE,
        order,
        _add_options,
        partial(run, service),
        help=what,
        description=f"{meaning} The command calls the service sequencer/{service}, prints the"
        " answer and ends; it works from any terminal and for a run of any client. The exit code"
        " is 1 if the sequencer refuses or is not there.",
        epilog=f"example: stepdiag {service} --namespace /cell_1",
    )


COMMANDS = (
    _command(
        41,
        "pause",
        "let a run stand still after the present stop",
        "Let the machine stand still after the present stop has been measured, until 'stepdiag"
        " resume'. This is not a safety function: to reach in, stop the machine at its control.",
    ),
    _command(
        42,
        "resume",
        "continue a run after a pause, a setup or a fault",
        "Continue a run. The machine moves: make sure that nobody is near it. After a pause,"
        " the run goes on. At a setup, you confirm that laser and mirror are aligned. After a"
        " fault, you confirm that its cause is removed; the present line is measured again. The"
        " exit code is also 1 if the machine cannot be made ready, and the run stays held.",
    ),
    _command(
        43,
        "abort",
        "stop the machine at once and end the run",
        "Stop the machine at once and end the run; what was measured stays in the bag. In an"
        " emergency, use the emergency stop of the machine.",
    ),
)
