"""What a supervisor decides on, as the message ``RunVerdict``."""

from typing import Any

from stepdiag_ros.messages.fields import set_header
from stepdiag_ros.messages.target import write_target
from stepdiag_ros.messages.types import new_message
from stepdiag_ros.metrology.standards.decision import RunDecision
from stepdiag_ros.run.conclusion import Outcome
from stepdiag_ros.topics import RUN_VERDICT


def from_decision(
    decision: RunDecision,
    run_id: str,
    time: int,
    lines: tuple[int, int],
    run_over: bool,
    outcome: Outcome,
) -> Any:
    """Convert to a ``RunVerdict`` message.

    Args:
        decision: what is decided on.
        run_id: identity of the run.
        time: of the last line that was used, ns.
        lines: that were used, and that the plan has.
        run_over: the run has ended.
        outcome: how it has ended; UNKNOWN before.
    """
    message = new_message(RUN_VERDICT.type_name)
    set_header(message, time)
    message.run_id, message.run_over, message.outcome = run_id, run_over, int(outcome)
    message.lines, message.lines_planned = lines
    message.conformity, message.diagnosis = int(decision.conformity), int(decision.diagnosis)
    message.worst_error = decision.worst_error
    message.expanded_uncertainty = decision.expanded_uncertainty
    message.coverage_factor, message.budgeted = decision.coverage_factor, decision.budgeted
    message.upper_bound = decision.upper_bound
    message.worst_place = list(decision.worst_place)
    message.tolerance = decision.tolerance
    message.method = decision.method
    message.not_determined = list(decision.not_determined)
    write_target(message, decision.target)
    return message
