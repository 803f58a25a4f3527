"""The catalogue: all effects by name, those of this package and those that others add."""

from stepdiag_ros.metrology.effects.effect import Effect
from stepdiag_ros.metrology.registry import of_modules, with_added

ENTRY_POINTS = "stepdiag_ros.effects"
"""Group of entry points by which another package adds effects; each names an ``Effect``."""


def catalogue() -> dict[str, Effect]:
    """Return all effects by their names: those of this package first, in alphabetical order.

    An effect is the attribute ``EFFECT`` of a module of this package, or an entry point of the
    group ``stepdiag_ros.effects`` that names an ``Effect``.

    Raises:
        ValueError: an entry point cannot be loaded, is not an effect, or takes a name that is
            there; says which and of which package.
    """
    own: list[Effect] = of_modules("stepdiag_ros.metrology.effects", "EFFECT")
    return with_added(own, ENTRY_POINTS, "effect", _fault)


def _fault(effect: object) -> str:
    """Return what keeps an object from being an effect; empty if nothing does."""
    if not isinstance(effect, Effect):
        return "is not an object of a class derived from Effect"
    for name in ("name", "sentence", "source", "sizes"):
        if not getattr(effect, name, None):
            return f"does not state its '{name}'"
    names = [size.name for size in effect.sizes]
    if len(set(names)) < len(names):
        return "has two sizes of one name"
    return ""
