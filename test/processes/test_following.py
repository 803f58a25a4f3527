"""What is refused while a node is stopped: held, and granted once the node wakes."""

from types import SimpleNamespace

import pytest

from stepdiag_ros.parameters.devices import MANAGED
from stepdiag_ros.processes.following import REOPEN_LIMIT, SETTLE_LIMIT, FollowedRun, RunFailed
from stepdiag_ros.run.taking_up import HELD_LIMIT

ASKING = 10.0
"""Seconds that the sequencer takes to refuse a start: it waits for nodes that may be starting."""


class RefusingOperator:
    """Refuses a start, or a resumption, until a moment; the time is its own."""

    def __init__(self, until: float) -> None:
        self.until, self.time = until, 0.0
        self.result = None
        self.state = SimpleNamespace(state=6, line_index=3, text="bridge is silent")
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

    def call(self, service: str) -> None:
        assert service == "sequencer/resume"
        self.start("")
        self.state = SimpleNamespace(state=1, line_index=3, text="")


def started(operator: RefusingOperator, stopped_until: float) -> str:
    """Return the run that begins where a node is stopped until a moment."""
    return followed(operator, stopped_until)._until_granted(
        lambda: operator.start(""), SETTLE_LIMIT
    )


def followed(operator: RefusingOperator, stopped_until: float) -> FollowedRun:
    return FollowedRun(
        operator, lambda _: None, lambda: operator.time < stopped_until, lambda *_: False
    )


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


def test_a_refused_resumption_is_tried_again():
    operator = RefusingOperator(ASKING)
    followed(operator, ASKING)._resume()
    assert operator.state.state == 1


def test_a_device_that_failed_may_be_opened_again_before_a_resumption_is_given_up():
    reopened = next(one.default for one in MANAGED if one.name == "retry_after")
    assert 2.0 * reopened < REOPEN_LIMIT
    operator = RefusingOperator(reopened)
    operator.call = lambda _: promptly(operator)
    followed(operator, 0.0)._resume()
    assert reopened <= operator.time < REOPEN_LIMIT and operator.state.state == 1


def promptly(operator: RefusingOperator) -> None:
    """Refuse a resumption at once until the moment, and grant it from then on."""
    if operator.time < operator.until:
        raise ValueError("the device will be opened again in 5 s")
    operator.state = SimpleNamespace(state=1, line_index=3, text="")


def test_a_resumption_that_is_refused_for_good_says_what_holds_the_run():
    operator = RefusingOperator(1e9)
    with pytest.raises(RunFailed) as caught:
        followed(operator, 0.0)._resume()
    assert "bridge is silent" in str(caught.value) and "recorder" in str(caught.value)


class SilentOperator(RefusingOperator):
    """Follows a run whose sequencer is heard as listed, look by look, and then ends it."""

    def __init__(self, heard: list[str]) -> None:
        super().__init__(0.0)
        self.heard, self.state, self.text = list(heard), None, ""
        self.sequencer = self.heard.pop(0)

    def spin_until(self, condition, limit: float) -> bool:
        if self.heard:
            self.sequencer = self.heard.pop(0)
        else:
            self.result = SimpleNamespace(outcome=0, text="", run_id="run")
        return super().spin_until(condition, limit)


@pytest.mark.parametrize("heard", [["", "one", "", "one"], ["one", "", "", "one"], ["", "", "one"]])
def test_a_sequencer_that_was_silent_is_the_same_when_it_is_heard_again(heard, monkeypatch):
    operator = SilentOperator(heard)
    run = followed(operator, 0.0)
    monkeypatch.setattr(run, "_has_result", lambda: operator.result is not None)
    run._follow()
    assert operator.result is not None


@pytest.mark.parametrize("heard", [["one", "two"], ["", "one", "two"], ["one", "", "two"]])
def test_a_sequencer_that_was_restarted_has_lost_the_run(heard, monkeypatch):
    operator = SilentOperator(heard)
    run = followed(operator, 0.0)
    monkeypatch.setattr(run, "_has_result", lambda: operator.result is not None)
    with pytest.raises(RunFailed):
        run._follow()
    assert operator.result is None
