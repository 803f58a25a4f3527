"""Whether commands belong to a plan."""

import numpy as np

from stepdiag_ros.metrology.measurement import StopCommand
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.refusal import Refusal


def check_command(command: StopCommand, plan: Plan) -> None:
    """Refuse a command that does not belong to a plan.

    Raises:
        Refusal: the plan has no such line or stop, or the stop is at another place.
    """
    if not 0 <= command.line_index < len(plan.lines):
        raise Refusal(
            f"command {command.command_id} is for line {command.line_index}, but the plan "
            f"'{plan.name}' has {len(plan.lines)} lines: the plan may have changed",
            fault="mismatch",
            aspect="line",
        )
    targets = plan.lines[command.line_index].stops(plan.volume)
    if not 0 <= command.stop < len(targets):
        raise Refusal(
            f"command {command.command_id} is for stop {command.stop}, but line "
            f"{command.line_index} has {len(targets)} stops: the plan may have changed",
            fault="mismatch",
            aspect="stop",
        )
    # Written so that a target that is not a number is refused too.
    if not np.max(np.abs(targets[command.stop] - np.asarray(command.target))) <= 1e-9:
        raise Refusal(
            f"command {command.command_id} goes to {command.target} m, but stop {command.stop} of"
            f" line {command.line_index} is at {tuple(targets[command.stop].tolist())} m: the"
            " plan may have changed",
            fault="mismatch",
            aspect="place",
        )
