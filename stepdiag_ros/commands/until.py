"""The options ``--until`` and ``--conditions``, and how far a run is that has them or not."""

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stepdiag_ros.commands.output import Progress
    from stepdiag_ros.metrology.target import TargetStanding
    from stepdiag_ros.processes.following import RunNews


def add_until(parser: ArgumentParser) -> None:
    """Add the options to the parser of a command that starts a run."""
    parser.add_argument(
        "--until",
        default="",
        metavar="U",
        help="end the run as soon as this expanded uncertainty is reached: 0.5um (of the largest"
        " error in the volume), E_XX=0.3um, C0Y=2urad, or X:A=1um of ISO 230-2 (default: measure"
        " all lines)",
    )
    parser.add_argument(
        "--conditions",
        type=Path,
        metavar="FILE",
        help="with --until of ISO 230-2: measuring conditions, as of 'stepdiag iso230"
        " --uncertainty'",
    )


def until_of(arguments: Namespace) -> str:
    """Return the target that was asked for, as the action Measure takes it; empty without one.

    Raises:
        ValueError: the target or the file of conditions cannot be read.
    """
    import yaml

    from stepdiag_ros.configuration import read_yaml, target_from_text
    from stepdiag_ros.metrology.refusal import Refusal

    text: str = arguments.until.strip()
    if arguments.conditions is not None:
        if not text:
            raise Refusal(
                "--conditions goes with --until: name the uncertainty to be reached",
                fault="missing",
                about="until",
            )
        told = {"until": text, "conditions": read_yaml(arguments.conditions)}
        text = yaml.safe_dump(told, allow_unicode=True)
    if text:
        target_from_text(text, "--until")
    return text


class TargetTeller:
    """Says after each solved line which uncertainty is reached, and how long it takes still.

    Args:
        say: writes a line.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._said: str = ""

    def __call__(self, standing: "TargetStanding | None") -> None:
        """Say where a run stands, if that is new; nothing of a run without a target."""
        from stepdiag_ros.run.target_words import course_words

        words = "" if standing is None else course_words(standing)
        if words and words != self._said:
            self._said = words
            self._say(words)


class RunTeller:
    """Shows the progress of a run: a bar on a terminal, in a pipe or file a line a pass.

    Args:
        progress: of the bar.
        say: writes a line.
    """

    def __init__(self, progress: "Progress", say: Callable[[str], None]) -> None:
        self._progress = progress
        self._say = say
        self._tell_of_target = TargetTeller(say)
        self._said = ""

    def __call__(self, told: "RunNews") -> None:
        """Show what is new."""
        self._tell_of_target(told.target)
        self._progress(told.done / told.total if told.total else 0.0, told.text)
        if told.total and told.text != self._said and not sys.stderr.isatty():
            self._said = told.text
            self._say(f"{told.text}: {told.done} of {told.total} stops are measured")
