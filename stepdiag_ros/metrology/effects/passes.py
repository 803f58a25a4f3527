"""How a setting names a pass or a setup of a run, and which stops belong to it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepdiag_ros.metrology.effects.effect import Key
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD, Line
from stepdiag_ros.metrology.refusal import Refusal

PASS_KEYS = (
    Key("line", str),
    Key("order", str),
    Key("repeat", int),
    Key("direction", (FORWARD, BACKWARD)),
    Key("from_stop", int),
)


def pass_setting(line: Line, from_stop: int) -> dict[str, Any]:
    """Return the setting that names a pass and a stop of it.

    The line carries its offset, for example ``x@0,0.12,0``; ``order`` is empty where all axes of
    the line move at once.
    """
    return {
        "line": line_name(line),
        "order": line.order,
        "repeat": line.repeat,
        "direction": line.direction,
        "from_stop": from_stop,
    }


def pass_words(setting: Mapping[str, Any]) -> str:
    """Say which pass it is, for example ``npp YZX forward, repeat 0``."""
    line = f"{setting['line']} {setting['order']}".strip()
    return f"{line} {setting['direction']}, repeat {setting['repeat']}"


def pass_rows(setting: Mapping[str, Any], stops: Stops) -> NDArray[np.bool_]:
    """Say of each stop whether it belongs to the pass, shape (n,).

    Raises:
        ValueError: the run has no such pass, or the pass no such stop.
    """
    for index, line in enumerate(stops.lines):
        if (
            line.order == setting["order"]
            and line.repeat == setting["repeat"]
            and line.direction == setting["direction"]
            and line_name(line) == setting["line"]
        ):
            rows: NDArray[np.bool_] = stops.pass_index == index
            if not setting["from_stop"] < np.count_nonzero(rows):
                raise Refusal(
                    f"{pass_words(setting)} has no stop {setting['from_stop']}", fault="not_found"
                )
            return rows
    raise Refusal(f"the run has no pass {pass_words(setting)}", fault="not_found")


def setup_index(setting: Mapping[str, Any], stops: Stops) -> int:
    """Return the index of the setup that a setting names.

    Raises:
        ValueError: the run has no such setup.
    """
    if setting["setup"] not in stops.setups:
        raise Refusal(
            f"the run has no setup '{setting['setup']}': {', '.join(stops.setups)}",
            fault="not_found",
        )
    return stops.setups.index(setting["setup"])


def line_name(line: Line) -> str:
    """Return the name of a line with its offset and without its order, such as ``ppp``."""
    return line.setup.replace(f" {line.order}", "") if line.order else line.setup
