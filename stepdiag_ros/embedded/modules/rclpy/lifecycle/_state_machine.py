"""The state machine of managed nodes: states, transitions and the rules between them."""

from __future__ import annotations

from typing import NamedTuple

from lifecycle_msgs.msg import State, Transition

#: Labels of the transitions that follow from what a callback returned.
SUCCESS, FAILURE, ERROR = "transition_success", "transition_failure", "transition_error"

#: Labels of all states by their numbers, in the order in which they are listed to others.
STATES: dict[int, str] = {
    State.PRIMARY_STATE_UNKNOWN: "unknown",
    State.PRIMARY_STATE_UNCONFIGURED: "unconfigured",
    State.PRIMARY_STATE_INACTIVE: "inactive",
    State.PRIMARY_STATE_ACTIVE: "active",
    State.PRIMARY_STATE_FINALIZED: "finalized",
    State.TRANSITION_STATE_CONFIGURING: "configuring",
    State.TRANSITION_STATE_CLEANINGUP: "cleaningup",
    State.TRANSITION_STATE_SHUTTINGDOWN: "shuttingdown",
    State.TRANSITION_STATE_ACTIVATING: "activating",
    State.TRANSITION_STATE_DEACTIVATING: "deactivating",
    State.TRANSITION_STATE_ERRORPROCESSING: "errorprocessing",
}
_NUMBERS = {label: number for number, label in STATES.items()}


class Step(NamedTuple):
    """A transition: its number and label, and the states before and after it."""

    number: int
    label: str
    start: int
    goal: int


def _steps() -> tuple[Step, ...]:
    steps: list[Step] = []

    def add(name: str, label: str, start: str, goal: str) -> None:
        number = getattr(Transition, f"TRANSITION_{name}")
        steps.append(Step(number, label, _NUMBERS[start], _NUMBERS[goal]))

    def outcomes(name: str, during: str, success: str, failure: str, error: str) -> None:
        add(f"ON_{name}_SUCCESS", SUCCESS, during, success)
        add(f"ON_{name}_FAILURE", FAILURE, during, failure)
        add(f"ON_{name}_ERROR", ERROR, during, error)

    for name, start, during, goal in (
        ("CONFIGURE", "unconfigured", "configuring", "inactive"),
        ("CLEANUP", "inactive", "cleaningup", "unconfigured"),
        ("ACTIVATE", "inactive", "activating", "active"),
        ("DEACTIVATE", "active", "deactivating", "inactive"),
    ):
        add(name, name.lower(), start, during)
        outcomes(name, during, success=goal, failure=start, error="errorprocessing")
    for start in ("unconfigured", "inactive", "active"):
        add(f"{start.upper()}_SHUTDOWN", "shutdown", start, "shuttingdown")
    outcomes("SHUTDOWN", "shuttingdown", "finalized", "finalized", "errorprocessing")
    outcomes("ERROR", "errorprocessing", "unconfigured", "finalized", "finalized")
    return tuple(steps)


#: All transitions, in the order in which they are listed to others.
STEPS = _steps()


class StateMachine:
    """Where a node is among the states."""

    def __init__(self) -> None:
        self._state: int = State.PRIMARY_STATE_UNCONFIGURED

    @property
    def current_state(self) -> tuple[int, str]:
        """Number and label of the present state."""
        return self._state, STATES[self._state]

    def available_steps(self) -> list[Step]:
        """Return the transitions that may be made now."""
        return [step for step in STEPS if step.start == self._state]

    def find(self, transition: int | str) -> Step | None:
        """Return the transition of a number or label that may be made now, ``None`` if none."""
        for step in self.available_steps():
            if transition in (step.number, step.label):
                return step
        return None

    def make(self, step: Step) -> None:
        """Change the state by a transition that :meth:`find` returned."""
        self._state = step.goal
