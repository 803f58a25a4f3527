"""``stepdiag watch``: a run, or a bag as if it were one, in the terminal."""

import os
import signal
import sys
import threading
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepdiag_ros import topics
from stepdiag_ros.commands.arguments import Command, Group, add_common
from stepdiag_ros.commands.onlooking import (
    add_rate_option,
    rate_of,
    refuse_what_does_not_fit,
    ros_arguments,
)
from stepdiag_ros.commands.output import say

if TYPE_CHECKING:
    from stepdiag_ros.nodes.onlooker import ViewerNode
    from stepdiag_ros.viewers.page.state import PageState
    from stepdiag_ros.viewers.terminal.journal import Journal
    from stepdiag_ros.viewers.terminal.screen import Screen

_ONCE_LIMIT = 10.0
"""Real seconds that --once waits for a run."""
_ONCE_MORE = 1.5
"""Real seconds without another node after which a late subscriber has all current messages, once
the state is known.
"""


def _add_options(parser: ArgumentParser) -> None:
    parser.add_argument("bag", type=Path, nargs="?", help="bag to play (default: the live run)")
    add_rate_option(parser)
    add_common(parser, "run")
    parser.add_argument("--once", action="store_true", help="print the whole view once and end")
    add_common(parser, "namespace")


def run(arguments: Namespace) -> int:
    """Show until the bag or the user ends it."""
    refuse_what_does_not_fit(arguments)
    return _replay(arguments) if arguments.bag is not None else _live(arguments)


def _is_screen() -> bool:
    """Say whether the output is a terminal that can be drawn on."""
    return sys.stdout.isatty() and os.environ.get("TERM", "dumb") not in ("dumb", "unknown", "")


def _make_screen(
    state: "PageState", source: Callable[[], str], clock: Callable[[], datetime]
) -> "Screen":
    from stepdiag_ros.text.console import PlainConsole
    from stepdiag_ros.viewers.terminal.page import Heading
    from stepdiag_ros.viewers.terminal.screen import Screen

    console = PlainConsole(file=sys.stdout, markup=False, highlight=False, emoji=False)
    return Screen(state, console, lambda: Heading(source(), f"{clock():%H:%M:%S} UTC"))


def _make_journal(state: "PageState", clock: Callable[[], datetime]) -> "Journal":
    from stepdiag_ros.viewers.terminal.glyphs import glyphs_for
    from stepdiag_ros.viewers.terminal.journal import Journal

    journal = Journal(
        state,
        glyphs_for(sys.stdout.encoding or "ascii"),
        clock,
        lambda text: print(text, flush=True),
    )
    state.listener = journal.look
    return journal


def _replay(arguments: Namespace) -> int:
    from stepdiag_ros.viewers.page.replay import Replay
    from stepdiag_ros.viewers.page.state import PageState

    state = PageState()
    replay = Replay(arguments.bag, state, arguments.run_id)
    rate = 0.0 if arguments.once else rate_of(arguments)
    pace = f"{rate:g} x" if rate else "at once"

    def recorded() -> datetime:
        return datetime.fromtimestamp(replay.time * 1e-9, timezone.utc)

    screen = _make_screen(state, lambda: f"{arguments.bag.name}, {pace}", recorded)
    drawn = _is_screen() or arguments.once
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        if not drawn:
            _make_journal(state, recorded)
        elif not arguments.once:
            state.listener = screen.look
            screen.begin()
        replay.play(rate, threading.Event())
    except KeyboardInterrupt:
        return 0
    finally:
        screen.end()
        replay.close()
        signal.signal(signal.SIGTERM, before)
    if drawn:
        # The screen is given back; where the run ended is left on it.
        screen.print()
    return 0


def _live(arguments: Namespace) -> int:
    if sys.stderr.isatty():
        # On a busy computer, many seconds pass before anything can be drawn.
        say("looking for the nodes")
    from stepdiag_ros.nodes.base import spin
    from stepdiag_ros.nodes.onlooker import ViewerNode
    from stepdiag_ros.viewers.page.state import PageState
    from stepdiag_ros.viewers.terminal.screen import RATE

    sys.argv = ros_arguments("watch", "viewer", arguments.namespace)
    state = PageState()
    view: _Once | _Drawn | _Logged
    if arguments.once:
        view = _Once(state)
    elif _is_screen():
        view = _Drawn(state)
    else:
        view = _Logged(state)
    if not isinstance(view, _Logged):
        # What a node logs would be written across the view; its warnings are among the faults.
        sys.argv.append("--disable-stdout-logs")
    code = spin(lambda: ViewerNode(state, RATE, view.look, view.close))
    return code or view.finish()


def _now() -> datetime:
    return datetime.now(timezone.utc)


class _Drawn:
    """The live view on a terminal."""

    def __init__(self, state: "PageState") -> None:
        self._screen = _make_screen(state, lambda: self._contact, _now)
        self._contact = ""

    def look(self, node: "ViewerNode") -> bool:
        """Draw; the first time, take the terminal."""
        if not self._contact:
            self._screen.begin()
        self._contact = node.contact()
        self._screen.look()
        return False

    def close(self) -> None:
        """Give the terminal back."""
        self._screen.end()

    def finish(self) -> int:
        """Return the exit code."""
        return 0


class _Logged:
    """The live view as a log."""

    def __init__(self, state: "PageState") -> None:
        self._journal = _make_journal(state, _now)
        self._contact = ""

    def look(self, node: "ViewerNode") -> bool:
        """Print how many nodes answer, where changed; all else as it arrives."""
        if node.watch.peers and node.contact() != self._contact:
            self._contact = node.contact()
            self._journal.write(self._contact)
        return False

    def close(self) -> None:
        """Leave all as it is."""

    def finish(self) -> int:
        """Return the exit code."""
        return 0


class _Once:
    """The live view, printed once."""

    def __init__(self, state: "PageState") -> None:
        self._state = state
        self._screen = _make_screen(state, lambda: self._contact, _now)
        self._contact = ""
        self._elsewhere = ""
        self._begun = time.monotonic()
        self._known = 0.0

    def look(self, node: "ViewerNode") -> bool:
        """Say whether all is there that will come, or nothing comes."""
        before, self._contact = self._contact, node.contact()
        self._elsewhere = node.namespaces_with("sequencer")
        now = time.monotonic()
        if self._known and self._contact != before and now - self._begun < _ONCE_LIMIT:
            self._known = now
        run = self._state.document("run")
        # Whoever leads says that nothing is measured; else its description is still to come.
        if run["state"] and (run["run_id"] or run["state"] == "IDLE"):
            self._known = self._known or now
            waited = now - self._known > _ONCE_MORE
            return waited and (self._has_all_stops(run) or now - self._begun > _ONCE_LIMIT)
        return now - self._begun > _ONCE_LIMIT

    def _has_all_stops(self, run: "dict[str, Any]") -> bool:
        """Say whether as many stops have come as the run has: on a busy computer they are late."""
        trace = self._state.document("stop")["trace"]
        number = trace[-1][0] if trace else 0
        return bool(number >= min(run["stops_done"] or 0, topics.STOP.depth))

    def close(self) -> None:
        """Leave all as it is."""

    def finish(self) -> int:
        """Print the view.

        Raises:
            ValueError: no run is known.
        """
        run = self._state.document("run")
        if run["run_id"]:
            self._screen.print()
            return 0
        told = self._state.document("faults")
        # What is missing for a run to begin.
        for one in [*told["faults"], *told["starting"]]:
            print(f"{one.get('level', 'starting')}: {one['who']}: {one['text']}")
        if run["state"]:
            raise ValueError(f"no run has begun: {run['words']} ({self._contact})")
        raise ValueError(
            f"no run found within {_ONCE_LIMIT:g} s ({self._contact}). Check ROS_DOMAIN_ID and"
            f" --namespace{self._elsewhere}"
        )


COMMAND = Command(
    "watch",
    Group.WATCH,
    20,
    _add_options,
    run,
    help="in the terminal, also over ssh",
    description="Show the progress of the run, all faults, the beam, the last stop and blocks,"
    " the largest errors with their uncertainty, squareness, the gap to the model and the"
    " air, in a terminal of 80 x 24 characters or more. The command controls nothing. If the"
    " output is not a terminal, it is a log with one line and the time (UTC) for each"
    " important change. Without a bag, it shows the run on this ROS domain; with a bag, it"
    " plays the bag. End with Ctrl-C (docs/watch.md).",
    epilog="examples:\n"
    "  stepdiag watch                       the live run\n"
    "  stepdiag watch | tee watch.log       the same as a log\n"
    "  stepdiag watch --once                the present state; exit code 1 without a run\n"
    "  stepdiag watch RUN.mcap --rate 50    a recorded run, 50 times as fast",
)
