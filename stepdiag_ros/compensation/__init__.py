"""Compensation: from identified errors to the tables of a control, and what they leave.

One control a module behind the interface in ``control``; ``identified`` is what goes in,
``applied`` what a control does with its tables, ``remaining`` what is left of the errors then.
Nothing here writes a file, and nothing is ever installed on a machine: the operator loads
a table by hand.

A control is found, not listed: a module here holds it as ``CONTROL``, another package names it by
an entry point of the group ``stepdiag_ros.controls``.
"""

from functools import cache

from stepdiag_ros.compensation.control import Control
from stepdiag_ros.metrology.registry import of_modules, record_fault, with_added

ENTRY_POINTS = "stepdiag_ros.controls"
"""Group of entry points by which another package adds controls; each names a ``Control``."""


@cache
def controls() -> dict[str, Control]:
    """Return all controls by name: those of this package, then those that others add.

    Raises:
        ValueError: an entry point cannot be loaded, is not a control, or takes a name that is
            there.
    """
    own: list[Control] = of_modules("stepdiag_ros.compensation", "CONTROL")
    return with_added(own, ENTRY_POINTS, "control", _fault)


def control(name: str) -> Control:
    """Return a control.

    Raises:
        ValueError: the name is unknown.
    """
    known = controls()
    if name not in known:
        raise ValueError(f"there are no tables for '{name}'; there are for {', '.join(known)}")
    return known[name]


def _fault(found: object) -> str:
    return record_fault(found, Control)
