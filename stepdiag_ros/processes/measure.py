"""One measurement from the command line: start the nodes, start the run, follow it to its end."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from stepdiag_ros.parameters.nodes import declared_node
from stepdiag_ros.processes.following import ENDED, FollowedRun, RunFailed, RunNews
from stepdiag_ros.processes.graph import in_graph
from stepdiag_ros.processes.node_process import NodeProcess, Processes
from stepdiag_ros.run.identity import file_name_of
from stepdiag_ros.run.sequence import State
from stepdiag_ros.run.supervision import CLOCK_ROLE, DISPENSABLE, ONLOOKERS
from stepdiag_ros.run.taking_up import Patience, starting_words

if TYPE_CHECKING:
    from stepdiag_ros.nodes.operator import OperatorNode
    from stepdiag_ros.run.supervision import Peer

LOOK_AROUND = 1.5
"""Real seconds in which a measurement that already runs in the domain would be discovered."""
START_LIMIT = 40.0
"""Real seconds within which all nodes must be up."""
BUSY = "End other programs, or give a lower --factor"
"""What to do where a simulated run fails for want of time."""
_LOAD_ADVICE = (
    "Everything is simulated here: if the cell file does not ask for such a fault, this computer"
    " was too busy."
)
_ABORT_LIMIT = 10.0
"""Real seconds within which a run must have ended that is aborted."""
_LAST_RESULTS = 5.0
"""Real seconds that are left to the nodes for the results of a run that was aborted."""
LOOK_PERIOD = 0.5
"""Real seconds between two looks at nodes that start."""


class MeasuringSession:
    """Runs one plan on nodes that it starts and ends, or keeps these nodes up for others.

    Args:
        nodes: to be started.
        folder: bag and logs go there.
        tell: called with the progress of the run.
        namespace: of the nodes, such as ``/cell_1``; empty for none.
        on_machine: a device may be switched on later, and a run goes on without the nodes that are
            ``DISPENSABLE``.
        until: uncertainty to be reached, as in Measure.action; empty: all lines are measured.

    Attributes:
        bag: of the run; None before it has started.
    """

    def __init__(
        self,
        nodes: list[NodeProcess],
        folder: Path,
        tell: Callable[[RunNews], None],
        namespace: str = "",
        on_machine: bool = False,
        until: str = "",
    ) -> None:
        self._nodes = nodes
        self._folder = folder
        self._tell = tell
        self._namespace = namespace
        self._on_machine = on_machine
        self._until = until
        self.bag: Path | None = None

    def measure(self) -> Path:
        """Execute the whole run and return its bag.

        Raises:
            RunFailed: it did not finish; the machine stands still and the bag is closed.
            ValueError: the ROS graph cannot be joined.
            KeyboardInterrupt: as asked; the machine stands still and the bag is closed.
        """
        try:
            with self._started() as (operator, processes):
                return self._measure(operator, processes)
        except KeyboardInterrupt as error:
            raise type(error)(str(error) or "no run was begun") from None

    def keep_up(self, ready: Callable[[str], None]) -> NoReturn:
        """Keep the nodes up, for runs that others start, until this process is interrupted.

        Args:
            ready: called once all nodes are up, with what keeps them from a run; empty if nothing.

        Raises:
            RunFailed: another measurement is there, or a node has ended.
            ValueError: the ROS graph cannot be joined.
            KeyboardInterrupt: as asked; the machine stands still.
        """
        with self._started() as (operator, processes):
            missing = self._wait_for_nodes(operator, processes)
            ready(missing)
            try:
                self._look_on(operator, processes, self._faults(operator) if missing else {})
            except KeyboardInterrupt as error:
                if not _is_measuring(operator.last_state):
                    raise
                raise type(error)(self._recorded(operator.last_state)) from None
            except RunFailed as error:
                if not _is_measuring(operator.last_state):
                    raise
                self._tell(RunNews(str(error)))
                self._abort(operator, processes)
                raise RunFailed(
                    "a node has ended, and the run with it: start the cell and the run again. If"
                    " the bag is cut off, 'stepdiag recover' saves what was measured",
                    fault="stopped",
                ) from None

    def _abort(self, operator: "OperatorNode", processes: Processes) -> None:
        """End the run before its nodes end, so that its client receives a result.

        A sequencer that has ended itself is not asked: nobody would answer.
        """
        if not operator.sequencer or "sequencer" in processes.ended():
            return
        self._tell(RunNews("the run is aborted"))
        with suppress(ValueError):
            operator.call("sequencer/abort")
        operator.spin_until(lambda: not _is_measuring(operator.last_state), _ABORT_LIMIT)
        operator.spin_until(lambda: False, _LAST_RESULTS)

    def _faults(self, operator: "OperatorNode") -> dict[str, str]:
        """Return name → what is wrong with it, of the nodes that say so."""
        peers = self._of_a_measurement(operator)
        return {name: f"{peer.role}: {peer.text}" for name, peer in peers.items() if peer.faulty}

    def _look_on(
        self, operator: "OperatorNode", processes: Processes, faults: dict[str, str]
    ) -> NoReturn:
        missed: dict[str, str] = {}
        shown = ("", State.IDLE)
        while True:
            operator.spin_until(lambda: False, LOOK_PERIOD)
            self._check(operator, processes)
            shown = self._tell_of_runs(operator.last_state, *shown)
            if self._on_machine:
                # A device that is switched on later, or one whose node only now says that it waits.
                before, faults = faults, self._faults(operator)
                for name in faults.keys() - before.keys():
                    self._tell(RunNews(faults[name]))
                for name in before.keys() - faults.keys():
                    self._tell(RunNews(f"{name.rpartition('/')[2]}: ready"))
            ended = processes.ended()
            for name in ended.keys() - missed.keys():
                self._tell(RunNews(f"{ended[name]}; the other nodes go on"))
            missed = ended

    def _tell_of_runs(self, state: Any, run_id: str, before: State) -> tuple[str, State]:
        """Say that a run has begun, stands or has ended, and return which and its state.

        Any program of the ROS domain may start one: who keeps the cell must see it.
        """
        if state is None or not state.run_id:
            return run_id, before
        now = State(state.state)
        if state.run_id != run_id:
            self._tell(RunNews(f"run {state.run_id} was started"))
        if now is not before and now not in (State.IDLE, State.RUNNING):
            bag = self._folder / f"{file_name_of(state.run_id)}.mcap"
            where = f"; bag: {bag}" if now in (State.FINISHED, State.ABORTED) else ""
            self._tell(RunNews(f"run {state.run_id}: {state.text}{where}"))
        return state.run_id, now

    @contextmanager
    def _started(self) -> "Iterator[tuple[OperatorNode, Processes]]":
        from stepdiag_ros.nodes.operator import OperatorNode

        with in_graph(self._namespace):
            operator = OperatorNode()
            self._tell(RunNews("looking for other measurements"))
            # Their interpreters start while others are looked for; nothing of them is heard yet.
            with Processes(self._nodes, self._folder / "logs", held=True) as processes:
                self._refuse_company(operator)
                processes.release()
                yield operator, processes

    def _refuse_company(self, operator: "OperatorNode") -> None:
        operator.spin_until(lambda: bool(self._of_a_measurement(operator)), LOOK_AROUND)
        others = sorted(self._of_a_measurement(operator))
        if others:
            domain = os.environ.get("ROS_DOMAIN_ID", "0")
            alone = " (simulated cells share /clock, in whatever namespace)"
            raise RunFailed(
                f"another measurement is on ROS domain {domain} (node {others[0]}): end it, or set "
                f"ROS_DOMAIN_ID to another number{alone if self._simulated else ''}",
                fault="busy",
            )

    @property
    def _simulated(self) -> bool:
        return any(node.name == CLOCK_ROLE for node in self._nodes)

    def _of_a_measurement(self, operator: "OperatorNode") -> "dict[str, Peer]":
        """Return the nodes that answered and count beside those of this session.

        Nodes that only look on may always be there; so may simulated time, where time is real.
        """
        spared = ONLOOKERS if self._simulated else (*ONLOOKERS, CLOCK_ROLE)
        peers = operator.watch.peers
        return {name: peer for name, peer in peers.items() if peer.role not in spared}

    def _measure(self, operator: "OperatorNode", processes: Processes) -> Path:
        self._wait_for_nodes(operator, processes)
        run = FollowedRun(
            operator, self._tell, lambda: self._check(operator, processes, run), _go_on
        )
        try:
            measured = run.measure(until=self._until)
        except KeyboardInterrupt as error:
            raise type(error)(self._recorded(operator.last_state)) from None
        finally:
            if run.run_id:
                told = run.measured.bag if run.measured else None
                self.bag = told or self._folder / f"{file_name_of(run.run_id)}.mcap"
        if not measured.bag_closed or measured.bag is None:
            raise RunFailed(f"the bag is not whole: {measured.bag_text}")
        return measured.bag

    def _wait_for_nodes(self, operator: "OperatorNode", processes: Processes) -> str:
        """Wait until all nodes are up and well, and say which is not where that takes long.

        Each process is a node with a role of its own; all of them beat before anything is asked.

        Returns:
            what the nodes report that are up on a machine but not ready; else empty.

        Raises:
            RunFailed: a node has ended, or not all came up in time.
        """
        names = [declared_node(node.name).name for node in self._nodes]
        begun, patience = operator.real_time(), Patience(START_LIMIT)

        def all_up() -> bool:
            peers = self._of_a_measurement(operator)
            return len(peers) >= len(names) and not any(peer.faulty for peer in peers.values())

        while not operator.spin_until(all_up, LOOK_PERIOD):
            self._check(operator, processes)
            stopped, now = processes.stopped(), operator.real_time()
            peers = self._of_a_measurement(operator)
            heard = {name.rpartition("/")[2] for name in peers}
            unheard = [name for name in names if name not in heard]
            faults = list(self._faults(operator).values())
            words = starting_words(unheard, stopped, now - begun)
            if faults and not (unheard or stopped):
                words = f"waiting for {'; '.join(faults)}"
            self._tell(RunNews(words))
            if patience.is_over(bool(stopped), now):
                if self._on_machine and not unheard:
                    return "; ".join(faults)
                what = "not all came up" if unheard else "all are up, but not ready"
                count = f"{len(names) - len(unheard)} of {len(names)} nodes"
                raise RunFailed(
                    f"{count}: {what} after {START_LIMIT:g} s. {'; '.join(faults) or words}."
                    f" {self._advice()}"
                )
        self._check(operator, processes)
        return ""

    def _check(
        self, operator: "OperatorNode", processes: Processes, run: FollowedRun | None = None
    ) -> bool:
        """Return whether a node is stopped before the run has begun, and say so.

        Raises:
            RunFailed: a node has ended; it says what there is of the run then.
        """
        spared = DISPENSABLE if self._on_machine else ()
        ended = [text for name, text in processes.ended().items() if name not in spared]
        if not ended:
            stopped = {} if run is None or run.run_id else processes.stopped()
            if stopped:
                self._tell(RunNews(starting_words([], stopped, 0.0)))
            return bool(stopped)
        raise RunFailed(f"{ended[0]}; {self._recorded(operator.last_state)}")

    def _advice(self) -> str:
        """Say what to do where nodes do not come up."""
        logs = f"What the nodes say is in {self._folder / 'logs'}"
        if self._on_machine:
            return f"See to the devices, or end other programs. {logs}"
        return f"Everything is simulated here, so this computer was too busy. {BUSY}. {logs}"

    def _recorded(self, state: Any) -> str:
        """Say what there is of the last run, by its last RunState; None if there was no run."""
        bag = self._folder / f"{file_name_of(state.run_id if state else '')}.mcap"
        if not bag.exists():
            return "no bag was begun: start the run again"
        return f"{state.line_index} of {state.line_count} passes are in {bag}"


def _is_measuring(state: Any) -> bool:
    """Say whether a run has begun and has not ended, by its last RunState."""
    return state is not None and State(state.state) not in (State.IDLE, *ENDED)


def _go_on(state: State, text: str) -> bool:
    """Pass a pause for a setup: the simulated cell is aligned already, nobody has to touch it."""
    if state is State.FAULT:
        # What the recorder could not write is no matter of a busy computer; what it misses may be.
        unwritten = text.startswith("recorder: ") and " has come " not in text
        advice = "" if unwritten else f". {_LOAD_ADVICE} {BUSY}"
        raise RunFailed(f"the run has stopped: {text}{advice}")
    return state is State.WAITING_FOR_SETUP
