"""How long a starting run waits for the nodes that it needs, and what it reports meanwhile.

A node that answers must take up the run within seconds; one that does not will not do so later
either. A node that has fallen silent may only be stopped (SIGSTOP, a debugger, a suspended
computer): the run is held, says so and what to do, and goes on as soon as the node answers.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import nan

from stepdiag_ros.run.supervision import REFUSES, Watch, said_of_run

TAKE_UP_LIMIT = 5.0
"""Real seconds within which a node that answers must have taken up a new run."""
HELD_LIMIT = 60.0
"""Real seconds for which a beginning run is held for nodes that are silent or stopped."""
REMEDY = (
    "if its process is stopped, continue it (kill -CONT), else start it again; the run begins then"
)


class Patience:
    """Counts a wait; the time for which it is held by a node that may yet wake counts apart.

    Args:
        limit: real s of waiting while nothing holds it.
        held_limit: real s for which it may be held at a stretch.
    """

    def __init__(self, limit: float, held_limit: float = HELD_LIMIT) -> None:
        self._limit, self._held_limit = limit, held_limit
        self._waited = self._held = 0.0
        self._looked = nan

    def is_over(self, held: bool, real: float) -> bool:
        """Say whether it has been waited long enough (``real``: s of a clock that never steps)."""
        step = real - self._looked
        # Written so that the first look, with no time before it, counts nothing.
        step = step if step > 0.0 else 0.0
        self._looked = real
        if held:
            # Whoever wakes gets the whole limit.
            self._waited, self._held = 0.0, self._held + step
        else:
            self._waited, self._held = self._waited + step, 0.0
        return self._waited > self._limit or self._held > self._held_limit


@dataclass(frozen=True)
class Look:
    """What one look at a beginning run has found.

    Attributes:
        begins: every node has taken it up, and finds the others.
        text: what is waited for, and what to do where a node is silent.
        gives_up: it is not waited for any more.
    """

    begins: bool
    text: str = ""
    gives_up: bool = False


class TakingUp:
    """Waits for the nodes of a run that was described just now.

    Args:
        run_id: of the run.
        followers: roles that must say that they have taken it up.
        needed: roles without which it cannot begin.
        patience: factor by which nodes may take longer.
    """

    def __init__(
        self,
        run_id: str,
        followers: Sequence[str],
        needed: Collection[str],
        patience: float = 1.0,
    ) -> None:
        self._run_id = run_id
        self._followers, self._needed = tuple(followers), frozenset((*needed, *followers))
        self._patience = Patience(TAKE_UP_LIMIT * patience)

    def look(self, watch: Watch, real: float) -> Look:
        """Look at the nodes (``real``: s of the clock of their messages)."""
        for peer in watch.peers.values():
            why = said_of_run(peer, REFUSES, self._run_id)
            if why and peer.role in self._needed and not watch.present(peer.role, self._run_id):
                return Look(False, why, gives_up=True)
        silent = [
            sentence
            for name, sentence in watch.lost.items()
            if watch.peers[name].role in self._needed and not watch.present(watch.peers[name].role)
        ]
        behind = [role for role in self._followers if not watch.present(role, self._run_id)]
        deaf = watch.deaf(self._needed)
        if not behind and not silent and not deaf:
            return Look(begins=True)
        over = self._patience.is_over(bool(silent), real)
        if silent:
            return Look(False, f"{'; '.join(silent)}: {REMEDY}", over)
        names = ", ".join(behind)
        if over:
            why = f"{names} did not take up the run" if behind else "; ".join(deaf)
            return Look(False, why, gives_up=True)
        if behind:
            return Look(False, f"waiting for {names} to take up the run")
        return Look(False, f"waiting: {'; '.join(deaf)}")


def starting_words(unheard: Sequence[str], stopped: dict[str, int], waited: float) -> str:
    """Say what is waited for while the nodes of a measurement start.

    Args:
        unheard: names of the nodes that have not answered yet.
        stopped: name → process of those that are stopped.
        waited: real s since they were started.
    """
    if stopped:
        names = " and ".join(f"the {name} node" for name in stopped)
        processes = " ".join(map(str, stopped.values()))
        are = "is" if len(stopped) == 1 else "are"
        return f"{names} {are} stopped: 'kill -CONT {processes}' lets the measurement go on"
    if unheard and waited > TAKE_UP_LIMIT:
        return f"starting the nodes: no message yet from {', '.join(unheard)}"
    return "starting the nodes"
