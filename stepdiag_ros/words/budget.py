"""What the quantities of an uncertainty budget are called."""

from stepdiag_ros.metrology.geometry import SQUARENESS
from stepdiag_ros.metrology.uncertainty.budget import Budget
from stepdiag_ros.metrology.uncertainty.source import (
    AIR,
    ANGULAR,
    DEAD_PATH,
    DIRECT,
    DRIFT,
    INSTRUMENT,
    MATERIAL,
    MODEL,
    REPEATABILITY,
    SETUP,
)
from stepdiag_ros.metrology.units import IN_MICRO

UNITS = {
    "m": ("µm", IN_MICRO),
    "rad": ("µrad", IN_MICRO),
    "relative": ("µm/m", IN_MICRO),
    "m/m": ("µm/m", IN_MICRO),
    "1/K": ("µm/(m K)", IN_MICRO),
    "K": ("K", 1.0),
    "Pa": ("Pa", 1.0),
    "1": ("", 1.0),
}
"""Unit of an input → how people read it, and the factor."""
_KNOWN = "Give a better known value of it with --instrument"
_REPEATS = "Measure more repeats"
LOWERED_BY = {
    **dict.fromkeys((INSTRUMENT, AIR, DEAD_PATH, MATERIAL, SETUP), _KNOWN),
    **dict.fromkeys((REPEATABILITY, DRIFT), _REPEATS),
    MODEL: "Find its cause: stepdiag diagnose",
    ANGULAR: "Measure the lines of 'stepdiag plan --for angular' as well, or measure the angles and"
    " give them with --direct, or state their size as 'rotations' in the machine file",
    DIRECT: "Measure directly with a smaller uncertainty",
}
"""Group of sources → what lowers its contribution."""


_KINDS = {
    "squareness": "Squareness",
    "positioning": "Positioning error at the end of the travel",
    "diagonal": "Displacement error over body diagonals",
    "straightness": "Straightness",
    "angular": "Angular error motions",
}
"""First word of a figure's name (squareness has none of its own) → title of its table."""


def figure_groups(budget: Budget) -> dict[str, list[int]]:
    """Return the figures of a budget by their kind: title → places of its quantities."""
    found: dict[str, list[int]] = {}
    for kind, title in _KINDS.items():
        rows = [
            row
            for row, quantity in enumerate(budget.sensitivity.quantities)
            if not quantity.curve and _kind(quantity.name) == kind
        ]
        if rows:
            found[title] = rows
    return found


def _kind(name: str) -> str:
    return "squareness" if name in SQUARENESS else name.split(" ")[0]


def short_name(name: str) -> str:
    """Return a figure's name for the head of a narrow column: ``positioning E_XX`` → ``E_XX``."""
    return name.split(" ")[-1]


def unit_of(name: str, unit: str) -> str:
    """Return the unit in which people read a quantity; both are a millionth of SI."""
    if unit == "m":
        return "µm"
    return "µm/m" if name in SQUARENESS else "µrad"
