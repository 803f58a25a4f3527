"""A run whose start is refused while a node is stopped: held, and begun once the node wakes."""

import pytest

from stepdiag_ros.run.taking_up import HELD_LIMIT
from stepdiag_ros.session.following import SETTLE_LIMIT, FollowedRun, RunFailed

ASKING = 10.0
"""Seconds that the sequencer takes to refuse a start: it waits for nodes that may be starting."""


class RefusingOperator:
    """Refuses a start until a moment; the time is its own."""

    def __init__(self, until: float) -> None:
        self.until, self.time = until, 0.0
        self.result = self.state = None
        self.sequencer = "one"

    def real_time(self) -> float:
        return self.time

    def spin_until(self, condition, limit: float) -> bool:
        self.time += limit
        return bool(condition())

    def start(self, _: str) -> str:
        if self.time >= self.until:
            return "run"
        self.time += ASKING
        raise ValueError("there is no recorder node")


def started(operator: RefusingOperator, stopped_until: float) -> str:
    """Return the run that begins where a node is stopped until a moment."""
    run = FollowedRun(
        operator, lambda _: None, lambda: operator.time < stopped_until, lambda *_: False
    )
    return run._start("")


def test_a_stopped_node_is_waited_for():
    wakes = HELD_LIMIT - ASKING
    assert started(RefusingOperator(wakes), wakes) == "run"


def test_nothing_is_waited_for_where_no_node_is_stopped():
    operator = RefusingOperator(1e9)
    with pytest.raises(RunFailed):
        started(operator, 0.0)
    assert operator.time < ASKING + SETTLE_LIMIT


def test_a_node_that_stays_stopped_is_not_waited_for_without_end():
    operator = RefusingOperator(1e9)
    with pytest.raises(RunFailed):
        started(operator, 1e9)
    assert HELD_LIMIT < operator.time < HELD_LIMIT + 2.0 * ASKING
