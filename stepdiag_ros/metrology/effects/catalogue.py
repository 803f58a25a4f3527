"""The catalogue: all effects by name, those of this package and those that others add."""

from importlib import import_module
from importlib.metadata import entry_points
from pkgutil import iter_modules

from stepdiag_ros.metrology.effects.effect import Effect
from stepdiag_ros.metrology.refusal import Refusal

ENTRY_POINTS = "stepdiag_ros.effects"
"""Group of entry points by which another package adds effects; each names an ``Effect``."""

_PACKAGE = "stepdiag_ros.metrology.effects"


def catalogue() -> dict[str, Effect]:
    """Return all effects by their names: those of this package first, in alphabetical order.

    An effect is the attribute ``EFFECT`` of a module of this package, or an entry point of the
    group ``stepdiag_ros.effects`` that names an ``Effect``.

    Raises:
        ValueError: an entry point cannot be loaded, is no effect, or takes a name that is there;
            says which and of which package.
    """
    found: dict[str, Effect] = {}
    package = import_module(_PACKAGE)
    for module in sorted(iter_modules(package.__path__), key=lambda one: one.name):
        effect = getattr(import_module(f"{_PACKAGE}.{module.name}"), "EFFECT", None)
        if isinstance(effect, Effect):
            found[effect.name] = effect
    for point in sorted(entry_points(group=ENTRY_POINTS), key=lambda one: one.name):
        origin = f" of the package {point.dist.name}" if point.dist is not None else ""
        where = f"the effect '{point.name}'{origin} ({point.value})"
        try:
            effect = point.load()
        except Exception as error:  # whatever a foreign module does when it is imported
            raise Refusal(f"{where} cannot be loaded: {error}", fault="failed") from error
        fault = _fault(effect)
        if fault:
            raise Refusal(f"{where} {fault}", fault="wrong_kind")
        if effect.name in found:
            raise Refusal(
                f"{where} is named '{effect.name}', which is another effect's name", fault="twice"
            )
        found[effect.name] = effect
    return found


def _fault(effect: object) -> str:
    """Return what keeps an object from being an effect; empty if nothing does."""
    if not isinstance(effect, Effect):
        return "is no object of a class derived from Effect"
    for name in ("name", "sentence", "source", "sizes"):
        if not getattr(effect, name, None):
            return f"does not tell its '{name}'"
    names = [size.name for size in effect.sizes]
    if len(set(names)) < len(names):
        return "has two sizes of one name"
    return ""
