"""One measurement from the command line: start the nodes, start the run, follow it to its end."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepdiag_ros.run.sequence import State
from stepdiag_ros.session.graph import in_graph
from stepdiag_ros.session.processes import NodeProcess, Processes

if TYPE_CHECKING:
    from stepdiag_ros.nodes.operator import OperatorNode

LOOK_AROUND = 1.5
"""Real seconds in which a measurement that already runs in the domain would be heard."""
START_LIMIT = 40.0
"""Real seconds within which all nodes must be up."""
SETTLE_LIMIT = 3.0
"""Real seconds in which a refused start is tried again."""
RESUME_LIMIT = 5.0
"""Real seconds in which the run must go on after it was resumed."""
CLOSE_LIMIT = 15.0
"""Real seconds that the recorder has to close the bag after the run and the last result."""


class RunFailed(ValueError):
    """The run did not finish; the text says why, and what was recorded."""


@dataclass(frozen=True)
class Told:
    """What whoever shows the run is told (fields of RunState.msg).

    Attributes:
        text: what is going on, in words.
        done: stops measured.
        total: stops of the plan; 0 while the nodes start.
        remaining: s of ROS time; NaN if not known.
    """

    text: str
    done: int = 0
    total: int = 0
    remaining: float = float("nan")


class Session:
    """Runs one plan on nodes that it starts and ends.

    Args:
        nodes: to be started.
        folder: bag and logs go there.
        tell: is told how far the run is.

    Attributes:
        bag: of the run; None before it has started.
    """

    def __init__(
        self, nodes: list[NodeProcess], folder: Path, tell: Callable[[Told], None]
    ) -> None:
        self._nodes = nodes
        self._folder = folder
        self._tell = tell
        self.bag: Path | None = None

    def measure(self) -> Path:
        """Execute the whole run and return its bag.

        Raises:
            RunFailed: it did not finish; the machine stands still and the bag is closed.
            ValueError: the ROS graph cannot be joined.
            KeyboardInterrupt: as asked; the machine stands still and the bag is closed.
        """
        from stepdiag_ros.nodes.operator import OperatorNode

        with in_graph():
            operator = OperatorNode()
            self._tell(Told("looking for other measurements"))
            self._refuse_company(operator)
            with Processes(self._nodes, self._folder / "logs") as processes:
                return self._measure(operator, processes)

    def _refuse_company(self, operator: "OperatorNode") -> None:
        operator.spin_until(lambda: bool(operator.watch.peers), LOOK_AROUND)
        others = sorted(operator.watch.peers)
        if others:
            domain = os.environ.get("ROS_DOMAIN_ID", "0")
            raise RunFailed(
                f"another measurement is on ROS domain {domain} (node {others[0]}): end it, or set "
                "ROS_DOMAIN_ID to another number"
            )

    def _measure(self, operator: "OperatorNode", processes: Processes) -> Path:
        self._tell(Told("starting the nodes"))
        # Each process is a node with a role of its own; all of them beat before anything is asked.
        count = len(self._nodes)
        peers = operator.watch.peers

        def all_up() -> bool:
            return len(peers) >= count and not any(peer.faulty for peer in peers.values())

        operator.spin_until(lambda: all_up() or bool(processes.ended()), START_LIMIT)
        self._check(processes)
        if not all_up():
            faults = [f"{peer.role}: {peer.text}" for peer in peers.values() if peer.faulty]
            raise RunFailed(f"only {len(peers)} of {count} nodes came up. {'; '.join(faults)}")
        self.bag = self._folder / f"{self._start(operator)}.mcap"
        try:
            self._follow(operator, processes)
        except BaseException:
            self._abort(operator)
            raise
        finally:
            closed = self._wait_for_bag(operator)
        if not closed:
            raise RunFailed("the recorder has not closed the bag in time")
        return self.bag

    def _start(self, operator: "OperatorNode") -> str:
        deadline = operator.real_time() + SETTLE_LIMIT
        while True:
            try:
                return operator.start()
            except ValueError as error:
                # The sequencer may not have heard yet what this node has heard already.
                if operator.real_time() > deadline:
                    raise RunFailed(str(error)) from None
            operator.spin_until(lambda: False, 0.2)

    def _follow(self, operator: "OperatorNode", processes: Processes) -> None:
        ended = (State.FINISHED, State.ABORTED, State.FAULT)
        while operator.state is None or operator.state.state not in ended:
            operator.spin_until(lambda: False, 0.2)
            self._check(processes)
            if operator.state is not None:
                self._tell(_told(operator.state))
                if operator.state.state == State.WAITING_FOR_SETUP:
                    # The simulated cell is aligned already; nobody has to touch it.
                    self._resume(operator)
        if operator.state.state != State.FINISHED:
            raise RunFailed(f"the run has stopped: {operator.state.text}")

    def _resume(self, operator: "OperatorNode") -> None:
        setup = operator.state
        try:
            operator.call("sequencer/resume")
        except ValueError as error:
            raise RunFailed(f"{setup.text}: {error}") from None
        operator.spin_until(
            lambda: (
                operator.state.state != State.WAITING_FOR_SETUP
                or operator.state.line_index != setup.line_index
            ),
            RESUME_LIMIT,
        )

    def _wait_for_bag(self, operator: "OperatorNode") -> bool:
        """Wait for the results that nodes still owe, and for the bag; say whether it is closed."""
        while True:
            closed = operator.spin_until(
                lambda: _bag_is_closed(operator) or operator.watch.working(), CLOSE_LIMIT
            )
            if _bag_is_closed(operator) or not closed:
                return closed
            self._tell(Told("waiting for the last results"))
            operator.spin_until(lambda: not operator.watch.working(), CLOSE_LIMIT)

    def _check(self, processes: Processes) -> None:
        ended = processes.ended()
        if ended:
            raise RunFailed(ended)

    def _abort(self, operator: "OperatorNode") -> None:
        try:
            operator.call("sequencer/abort")
        except ValueError:
            # It has ended already, or the sequencer itself is what died.
            self._tell(Told("the run could not be aborted: it has ended or its sequencer is gone"))


def _told(state: Any) -> Told:
    words = {
        State.RUNNING: state.line,
        State.IDLE: "waiting until all nodes are ready for the run",
        State.WAITING_FOR_SETUP: f"aligning for {state.line}",
    }
    text = words.get(State(state.state), state.text)
    return Told(text, state.stops_done, state.stops_total, state.remaining_time)


def _bag_is_closed(operator: "OperatorNode") -> bool:
    recorders = [peer for peer in operator.watch.peers.values() if peer.role == "recorder"]
    return bool(recorders) and recorders[0].text.startswith("ready; recorded")
