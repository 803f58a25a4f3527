"""The catalogue: all effects by name, those of this package and those that others add."""

import re
from inspect import isabstract
from types import ModuleType

from stepdiag_ros.metrology.effects.effect import Effect, Key, Size
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.registry import modules_of, with_added

_PACKAGE = "stepdiag_ros.metrology.effects"
ENTRY_POINTS = "stepdiag_ros.effects"
"""Group of entry points by which another package adds effects; each names an ``Effect``."""
_PART = r"(?:m|s|kg|K|A|mol|cd|rad|sr|Hz|N|Pa|J|W|V|C|F|Ω|T)(?:\^\d)?"
_PRODUCT = rf"{_PART}(?:[ ·]{_PART})*"
_UNIT = rf"(?:1|{_PRODUCT})(?:/(?:{_PART}|\({_PRODUCT}\)))?"


def catalogue() -> dict[str, Effect]:
    """Return all effects by their names: those of this package first, by their modules' names.

    An effect is the attribute ``EFFECT`` of a module of this package, or an entry point of the
    group ``stepdiag_ros.effects`` that names an ``Effect``.

    Raises:
        ValueError: an effect is incomplete or takes a name that is there, a module of this package
            has one without ``EFFECT``, or an entry point cannot be loaded or is not an effect; says
            which and of which module or package.
    """
    own: list[Effect] = []
    for module in modules_of(_PACKAGE):
        if hasattr(module, "EFFECT"):
            own.append(module.EFFECT)
        elif forgotten := [kind for kind in vars(module).values() if _is_made_in(module, kind)]:
            name = forgotten[0].__name__
            raise Refusal(
                f"{module.__name__} has the effect {name}, but not EFFECT = {name}() at its end",
                fault="missing",
                about="EFFECT",
            )
    return with_added(own, ENTRY_POINTS, "effect", _fault)


def _is_made_in(module: ModuleType, kind: object) -> bool:
    return (
        isinstance(kind, type)
        and issubclass(kind, Effect)
        and not isabstract(kind)
        and kind.__module__ == module.__name__
    )


def _fault(effect: object) -> str:
    """Return what keeps an object from being an effect; empty if nothing does."""
    if not isinstance(effect, Effect):
        return "is not an object of a class derived from Effect"
    for name in ("name", "sentence", "source", "sizes"):
        if not getattr(effect, name, None):
            return f"does not state its '{name}'"
    for name, kind in (("sizes", Size), ("keys", Key)):
        told = getattr(effect, name)
        if not isinstance(told, tuple) or not all(isinstance(one, kind) for one in told):
            one = f"({kind.__name__}(...),)"
            return f"states '{name}' that are not a tuple of {kind.__name__}; a single one is {one}"
    for size in effect.sizes:
        if not size.low <= size.high:
            return f"states a range of its size '{size.name}' from {size.low:g} to {size.high:g}"
        if not re.fullmatch(_UNIT, size.unit):
            return (
                f"states the unit '{size.unit}' of its size '{size.name}', which is not a unit of"
                " the SI without prefix, such as m, rad, m/K or 1/m^2 (powers with ^)"
            )
    names = [size.name for size in effect.sizes]
    if len(set(names)) < len(names):
        return "has two sizes of one name"
    return ""
