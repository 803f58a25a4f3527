"""All methods: those of this package, and those that other packages add."""

from collections.abc import Iterable
from functools import cache

from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.registry import of_modules, record_fault, with_added
from stepdiag_ros.metrology.solvers.method import Method, Solver
from stepdiag_ros.metrology.solvers.tracker_methods import MULTILATERATION, SEVEN_LINES

ENTRY_POINTS = "stepdiag_ros.methods"
"""Group of entry points by which another package adds methods; each names a ``Method``."""


@cache
def own_methods() -> tuple[Method, ...]:
    """Return the methods of this package in their order."""
    found = [*of_modules("stepdiag_ros.metrology.solvers", "METHOD"), SEVEN_LINES, MULTILATERATION]
    return tuple(sorted(found, key=lambda one: one.order))


@cache
def methods() -> dict[str, Method]:
    """Return all methods by name: those of this package in their order, then those of others.

    Raises:
        ValueError: an entry point cannot be loaded, is not a method, or takes a name that is there;
            says which and of which package.
    """
    return with_added(own_methods(), ENTRY_POINTS, "method", _fault)


def solvers() -> dict[str, Solver]:
    """Return the solvers of measured lines, by the names of their methods, in the same order."""
    return {name: one.solve for name, one in methods().items() if one.solve is not None}


def in_order_of_reliance(names: Iterable[str]) -> list[str]:
    """Sort names of methods by how far to rely on them, the highest last.

    Names that nobody knows come first, as where a package that made a result is not installed.
    """
    places = {name: (one.reliance, place) for place, (name, one) in enumerate(methods().items())}
    return sorted(names, key=lambda name: places.get(name, (-1, 0)))


def to_rely_on(names: Iterable[str]) -> str | None:
    """Return the method to rely on of some; None if none of them may be relied on."""
    ranks = {name: methods()[name].reliance for name in names if name in methods()}
    best = max(ranks, key=lambda name: ranks[name], default=None)
    return best if best is not None and ranks[best] > 0 else None


def require_to_rely_on(names: Iterable[str], where: str) -> str:
    """Return the method to rely on of those that solved a run.

    Args:
        names: of the methods.
        where: the results are, for the refusal.

    Raises:
        ValueError: none of them may be relied on; one has to be named.
    """
    solved = tuple(names)
    best = to_rely_on(solved)
    if best is None:
        raise Refusal(
            f"{where}: solved by {', '.join(solved)} alone, which is not used by default. Name"
            " the method to use",
            fault="undetermined",
            aspect="method",
        )
    return best


def _fault(method: object) -> str:
    return record_fault(method, Method, ("title", "summary", "needs", "source"))
