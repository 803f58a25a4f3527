"""One run on a graph whose nodes were started by others, for example by a launch file."""

import os
from collections.abc import Callable
from typing import TYPE_CHECKING

from stepdiag_ros.processes.following import FollowedRun, RunFailed, RunNews, RunOutcome
from stepdiag_ros.processes.graph import in_graph
from stepdiag_ros.run.identity import file_name_of
from stepdiag_ros.run.sequence import State

if TYPE_CHECKING:
    from stepdiag_ros.nodes.operator import OperatorNode

GO_ON_LIMIT = 10.0
"""Real seconds within which a run must go on after it was resumed; the sequencer asks the bridge
several times to make the machine ready."""
LOOK_LIMIT = 5.0
"""Real seconds within which a running sequencer must have answered."""


class JoinedRun:
    """Starts a run on nodes that are there, and follows it.

    Args:
        namespace: of the nodes, such as ``/cell_1``; empty for none.
        tell: called with the progress of the run.
        on_hold: as that of ``FollowedRun``.
        on_plan: as that of ``FollowedRun``.

    Attributes:
        measured: what the run has come to; None before that is known, or where none has begun.
    """

    def __init__(
        self,
        namespace: str,
        tell: Callable[[RunNews], None],
        on_hold: Callable[[State, str], bool],
        on_plan: Callable[[str], None] | None = None,
    ) -> None:
        self._namespace = namespace
        self._tell = tell
        self._on_hold = on_hold
        self._on_plan = on_plan
        self.measured: RunOutcome | None = None

    def measure(self, plan: str, until: str = "") -> None:
        """Execute a whole run.

        Args:
            plan: YAML text; empty for the plan of the sequencer.
            until: uncertainty to be reached, as in Measure.action; empty for the sequencer's own.

        Raises:
            RunFailed: there is no sequencer, it refuses, or the run was ended before all lines were
                measured.
            ValueError: the ROS graph cannot be joined.
            KeyboardInterrupt: as asked; the machine stands still and the bag is closed.
        """
        try:
            with in_graph(self._namespace):
                self._measure(plan, until)
        except KeyboardInterrupt as error:
            raise type(error)(str(error) or "no run was begun") from None

    def _measure(self, plan: str, until: str) -> None:
        from stepdiag_ros.nodes.operator import OperatorNode

        operator = OperatorNode()
        self._tell(RunNews("looking for the nodes"))
        _wait_for_sequencer(
            operator,
            self._namespace,
            "start the nodes first ('stepdiag cell'), or measure on nodes of its own in the"
            " simulated cell with 'stepdiag run'",
        )
        run = FollowedRun(operator, self._tell, lambda: False, self._on_hold, self._on_plan)
        try:
            run.measure(plan, until)
        except KeyboardInterrupt as error:
            raise type(error)(_left_by(run) or "the request for a run was withdrawn") from None
        except RunFailed as error:
            left = _left_by(run) if run.measured is None else ""
            raise RunFailed(
                "; ".join(filter(None, (str(error), left))), fault=error.fault
            ) from None
        finally:
            self.measured = run.measured


def _left_by(run: FollowedRun) -> str:
    """Say which run was begun and what its bag is called; empty if none is known to have begun."""
    if not run.run_id:
        return ""
    name = f"{file_name_of(run.run_id)}.mcap"
    return f"run {run.run_id} was begun; its bag is {name} in the folder of the recorder"


def asked_of_sequencer(service: str, namespace: str) -> str:
    """Call a Trigger service of the sequencer and return its answer.

    Args:
        service: ``pause``, ``resume`` or ``abort``.
        namespace: of the nodes, such as ``/cell_1``; empty for none.

    Raises:
        RunFailed: there is no sequencer, or a run that was resumed does not go on.
        ValueError: it refuses or does not answer, or the ROS graph cannot be joined.
    """
    from stepdiag_ros.nodes.operator import OperatorNode

    with in_graph(namespace):
        operator = OperatorNode()
        _wait_for_sequencer(
            operator, namespace, "give the --namespace and the ROS_DOMAIN_ID of the run"
        )
        answer = operator.call(f"sequencer/{service}")
        if service == "resume":
            _see_it_go_on(operator)
        return answer


def _see_it_go_on(operator: "OperatorNode") -> None:
    """Wait until a run that was resumed is no longer held by its fault.

    Raises:
        RunFailed: the machine cannot be made ready; the text is what the run says of itself.
    """
    held = operator.last_state

    def decided() -> bool:
        now = operator.last_state
        return now is not None and (
            now.state != State.FAULT or (held is not None and now.text != held.text)
        )

    operator.spin_until(decided, GO_ON_LIMIT)
    now = operator.last_state
    if now is not None and now.state == State.FAULT:
        raise RunFailed(f"the run does not go on: {now.text}", fault="stopped")


def _wait_for_sequencer(operator: "OperatorNode", namespace: str, otherwise: str) -> None:
    """Wait until the sequencer of the namespace reports itself.

    Raises:
        RunFailed: it is not there; says what to do ``otherwise``.
    """
    if not operator.spin_until(lambda: bool(operator.sequencer), LOOK_LIMIT):
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        where = f" in namespace {namespace}" if namespace else ""
        elsewhere = operator.namespaces_with("sequencer")
        raise RunFailed(
            f"there is no sequencer{where} on ROS domain {domain}: {otherwise}{elsewhere}"
        )
