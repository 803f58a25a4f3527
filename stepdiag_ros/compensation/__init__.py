"""Compensation: from identified errors to the tables of a control, and what they leave.

One control a module behind the interface in ``control``; ``identified`` is what goes in,
``applied`` what a control does with its tables, ``remaining`` what is left of the errors then.
Nothing here writes a file, and nothing is ever installed on a machine: whoever loads a table does
so by hand.
"""

from importlib import import_module

from stepdiag_ros.compensation.control import Control

_CONTROLS = {
    "linuxcnc": "stepdiag_ros.compensation.linuxcnc",
    "siemens": "stepdiag_ros.compensation.siemens",
    "heidenhain": "stepdiag_ros.compensation.heidenhain",
    "fanuc": "stepdiag_ros.compensation.fanuc",
    "generic": "stepdiag_ros.compensation.generic",
}
"""Name of a control → module, which holds it as ``CONTROL``."""

CONTROLS = tuple(_CONTROLS)


def control(name: str) -> Control:
    """Return a control.

    Raises:
        ValueError: there is none of that name.
    """
    if name not in _CONTROLS:
        raise ValueError(f"there are no tables for '{name}'; there are for {', '.join(CONTROLS)}")
    found: Control = import_module(_CONTROLS[name]).CONTROL
    return found
