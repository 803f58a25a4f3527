"""What is found rather than listed: one thing a module, and those that other packages add."""

import re
from collections.abc import Callable, Iterable
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from stepdiag_ros.metrology.refusal import Refusal

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


class Named(Protocol):
    """Anything with a name of its own."""

    @property
    def name(self) -> str:
        """Return the name, which no other thing of its kind has."""


Thing = TypeVar("Thing", bound=Named)


def of_modules(package: str, attribute: str) -> list[Any]:
    """Return what the modules of a package hold under one name, in the modules' order by name.

    Args:
        package: its full name; all its modules are imported.
        attribute: modules without it are passed over.
    """
    found = (getattr(module, attribute, None) for module in modules_of(package))
    return [one for one in found if one is not None]


def modules_of(package: str) -> list[ModuleType]:
    """Return all modules of a package, imported, in the order of their names."""
    names = sorted(one.name for one in iter_modules(import_module(package).__path__))
    return [import_module(f"{package}.{name}") for name in names]


def record_fault(found: object, kind: type, told: Iterable[str] = ()) -> str:
    """Return what keeps an object from being a record of a kind; empty if nothing does.

    Args:
        found: what an entry point names.
        kind: of the records, each with a ``name`` that people type.
        told: attributes that must not be empty.
    """
    if not isinstance(found, kind):
        return f"is no {kind.__name__}"
    name: str = getattr(found, "name")  # noqa: B009 - of a kind that is known to the caller alone
    if not re.fullmatch("[a-z][a-z0-9_]*", name):
        return "has a name that is not of small letters, digits and underscores"
    missing = [one for one in told if not getattr(found, one)]
    return f"does not state its '{missing[0]}'" if missing else ""


def installed_points(group: str) -> Iterable["EntryPoint"]:
    """Return the entry points of a group, of all packages that are installed."""
    found: Iterable[EntryPoint] = _all_points().select(group=group)
    return found


@cache
def _all_points() -> Any:
    # Importing it takes longer than all else here, and most programs never get this far.
    from importlib.metadata import entry_points

    # To read the records of all packages takes most of the time; they are read once.
    return entry_points()


def with_added(
    own: Iterable[Thing], group: str, what: str, fault: Callable[[object], str]
) -> dict[str, Thing]:
    """Return things by name: our own, then those that other packages add by entry points.

    Args:
        own: those of this package, in their order.
        group: of the entry points.
        what: one of them is, in a word.
        fault: says what keeps an object from being one; empty if nothing does.

    Raises:
        ValueError: a thing is of another kind or takes a name that is there, or an entry point
            cannot be loaded; says which and of which module or package.
    """
    found: dict[str, Thing] = {}

    def add(added: Any, where: str) -> None:
        if wrong := fault(added):
            raise Refusal(f"{where} {wrong}", fault="wrong_kind")
        if added.name in found:
            raise Refusal(
                f"{where} is named '{added.name}', which is another {what}'s name", fault="twice"
            )
        found[added.name] = added

    for one in own:
        kind = one if isinstance(one, type) else type(one)
        add(one, f"the {what} '{getattr(one, 'name', kind.__name__)}' ({kind.__module__})")
    for point in sorted(installed_points(group), key=lambda one: one.name):
        origin = f" of the package {point.dist.name}" if point.dist is not None else ""
        where = f"the {what} '{point.name}'{origin} ({point.value})"
        try:
            added = point.load()
        except Exception as error:  # whatever a foreign module does when it is imported
            raise Refusal(f"{where} cannot be loaded: {error}", fault="failed") from error
        add(added, where)
    return found
