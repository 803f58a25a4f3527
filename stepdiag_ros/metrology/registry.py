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
    """Return all modules of a package, imported, in the order of their names.

    Raises:
        ValueError: a module cannot be imported; names it and what it raises.
    """
    names = sorted(one.name for one in iter_modules(import_module(package).__path__))
    return [_imported(f"{package}.{name}") for name in names]


def _imported(module: str) -> ModuleType:
    try:
        return import_module(module)
    except Exception as error:  # whatever a module does that somebody is writing
        raise Refusal(
            f"the module {module} cannot be loaded: {raised(error)}. Correct the module",
            fault="failed",
            about=module,
        ) from error


def raised(error: Exception) -> str:
    """Return an exception as Python names it, such as ``KeyError: 'size'``."""
    return f"{type(error).__name__}: {error}"


def record_fault(found: object, kind: type, told: Iterable[str] = ()) -> str:
    """Return what keeps an object from being a record of a kind; empty if nothing does.

    Args:
        found: what an entry point names.
        kind: of the records, each with a ``name`` that people type.
        told: attributes that must not be empty.
    """
    if not isinstance(found, kind):
        return f"is not an object of the class {kind.__name__}"
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

    def add(added: Any, where: str, remedy: str) -> None:
        if wrong := fault(added):
            raise Refusal(f"{where} {wrong}. {remedy}", fault="wrong_kind")
        if added.name in found:
            raise Refusal(
                f"{where} is named '{added.name}', which is another {what}'s name. {remedy}",
                fault="twice",
            )
        found[added.name] = added

    for one in own:
        kind = one if isinstance(one, type) else type(one)
        add(
            one,
            f"the {what} '{getattr(one, 'name', kind.__name__)}' ({kind.__module__})",
            "Correct its module",
        )
    for point in sorted(installed_points(group), key=lambda one: one.name):
        origin = f" of the package {point.dist.name}" if point.dist is not None else ""
        remedy = "Correct it, or uninstall its package"
        where = f"the {what} '{point.name}'{origin} ({point.value})"
        try:
            added = point.load()
        except Exception as error:  # whatever a foreign module does when it is imported
            raise Refusal(
                f"{where} cannot be loaded: {raised(error)}. {remedy}", fault="failed"
            ) from error
        add(added, where, remedy)
    return found
