"""How far a run is from its target, in words: alike in terminal, run state and report."""

from stepdiag_ros.metrology.target import TargetStanding, TargetState
from stepdiag_ros.text.numbers import in_micro, time_left


def standing_words(standing: TargetStanding) -> str:
    """Return what is reached and what was asked for: ``U of C0Y 3.1 µrad, target 2 µrad``."""
    reached = in_micro(standing.reached, standing.unit)
    return f"U of {standing.words} {reached}, target {in_micro(standing.demanded, standing.unit)}"


def course_words(standing: TargetStanding) -> str:
    """Say what is reached by the passes so far, and how long it takes still, or what hinders it."""
    words = standing_words(standing)
    if standing.lines:
        words += f" after {standing.lines} {'pass' if standing.lines == 1 else 'passes'}"
    if standing.state is TargetState.REACHED:
        return f"{words}: reached"
    if standing.state is TargetState.BEYOND_PLAN:
        return f"{words}: not expected to be reached, {standing.text}"
    expected = in_micro(standing.expected, standing.unit)
    left = time_left(standing.time_left)
    return (
        f"{words}: {left} left, about {expected} expected at the end of the plan; {standing.text}"
    )


def end_words(standing: TargetStanding | None, lines: int) -> str:
    """Say whether a run that has ended has reached its target, and if not, why.

    Args:
        standing: as last known; None if nothing was ever known.
        lines: passes that were measured.
    """
    if standing is not None and standing.state is TargetState.REACHED:
        return f"the target is reached: {standing_words(standing)}"
    if standing is None or standing.lines < lines:
        return "whether the target is reached is unknown: the last pass is not solved"
    return f"the target is not reached: {standing_words(standing)}; {standing.text}"
