"""A run that was resumed from another terminal: does it go on?"""

from types import SimpleNamespace

import pytest
from refused import refused

from stepdiag_ros.processes import joining
from stepdiag_ros.processes.following import RunFailed
from stepdiag_ros.run.sequence import State

HELD = SimpleNamespace(state=State.FAULT, text="the controller is inactive")
STILL_HELD = SimpleNamespace(state=State.FAULT, text="the controller is inactive; not resumed")
RUNNING = SimpleNamespace(state=State.RUNNING, text="measuring")


class Operator:
    """One that hears these states, one at each look."""

    def __init__(self, *states):
        self._states = list(states)
        self.last_state = self._states.pop(0)

    def spin_until(self, done, limit):
        assert limit == joining.GO_ON_LIMIT
        while not done() and self._states:
            self.last_state = self._states.pop(0)


@pytest.mark.parametrize("states", [(HELD, HELD, RUNNING), (RUNNING,), (None, RUNNING)])
def test_a_run_that_goes_on_is_seen_to(states):
    joining._see_it_go_on(Operator(*states))


@pytest.mark.parametrize("states", [(HELD, HELD, STILL_HELD, RUNNING), (HELD, HELD)])
def test_a_run_that_stays_held_is_a_failure_that_names_the_cause(states):
    with refused(RunFailed, "stopped", "inactive"):
        joining._see_it_go_on(Operator(*states))
