"""The message of a completed positioning test to its data class and back; see ``conversion``."""

from typing import Any

import numpy as np

from stepdiag_ros.messages.fields import doubles, set_header
from stepdiag_ros.messages.types import NewMessage, new_message
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.standards.iso230_2 import PositioningTest

_TYPE = "stepdiag_ros/msg/PositioningTest"
_COLUMNS = {
    "target": "target",
    "mean_forward": "mean_forward",
    "mean_backward": "mean_backward",
    "s_forward": "deviation_forward",
    "s_backward": "deviation_backward",
}
"""Field of the message → attribute of the data class; one value a target."""


def to_positioning_test(message: Any) -> PositioningTest:
    """Convert a ``PositioningTest`` message.

    Raises:
        ValueError: a column does not have one value a target, or the parameters' arrays differ.
    """
    columns = {
        attribute: np.array(getattr(message, field), dtype=np.float64)
        for field, attribute in _COLUMNS.items()
    }
    for attribute, values in columns.items():
        if len(values) != len(columns["target"]):
            raise Refusal(
                f"PositioningTest of {message.name}: '{attribute}' does not have one value for each"
                f" of {len(columns['target'])} targets",
                fault="mismatch",
            )
    names = [str(name) for name in message.parameter]
    if not len(names) == len(message.value) == len(message.expanded_uncertainty):
        raise Refusal(
            f"PositioningTest of {message.name}: parameter, value, expanded_uncertainty differ in"
            " length",
            fault="mismatch",
        )
    return PositioningTest(
        name=str(message.name),
        kind=str(message.kind),
        setup=str(message.setup),
        runs=(int(message.runs_forward), int(message.runs_backward)),
        parameters=dict(zip(names, map(float, message.value), strict=True)),
        expanded_uncertainty=dict(
            zip(names, map(float, message.expanded_uncertainty), strict=True)
        ),
        remarks=tuple(str(text) for text in message.remarks),
        **columns,
    )


def from_positioning_test(
    test: PositioningTest, run_id: str, time: int, new: NewMessage = new_message
) -> Any:
    """Make a ``PositioningTest`` message; time: of the last line that was used, ns."""
    message = new(_TYPE)
    set_header(message, time)
    message.run_id = run_id
    message.standard = test.standard
    message.name, message.kind, message.setup = test.name, test.kind, test.setup
    message.runs_forward, message.runs_backward = test.runs
    for field, attribute in _COLUMNS.items():
        setattr(message, field, doubles(getattr(test, attribute)))
    message.parameter = list(test.parameters)
    message.value = doubles(list(test.parameters.values()))
    message.expanded_uncertainty = doubles(
        [test.expanded_uncertainty[name] for name in test.parameters]
    )
    message.remarks = list(test.remarks)
    return message
