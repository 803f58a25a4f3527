"""How far a run is from its target, as part of the messages that carry it."""

from typing import Any

from stepdiag_ros.messages.fields import Carried, Field, Messages
from stepdiag_ros.messages.types import NewMessage, new_message
from stepdiag_ros.metrology.target import TargetStanding, TargetState

TARGET = Messages(
    "standing",
    "stepdiag_ros/msg/TargetStanding",
    Carried(TargetStanding, state=Field("state", TargetState)),
    (),
)
"""The field ``standing`` of RunState, of RunVerdict and of the feedback of Measure.action: one
message, or none where no target was asked for, or in an older bag."""


def target_of(message: Any) -> TargetStanding | None:
    """Return how far the run of a message is from its target; None if it has none."""
    found: tuple[TargetStanding, ...] = TARGET.read(message)
    return found[-1] if found else None


def write_target(
    message: Any, standing: TargetStanding | None, new: NewMessage = new_message
) -> None:
    """Write how far a run is from its target into a message; None: it has none."""
    TARGET.write(message, () if standing is None else (standing,), new)
