"""Effects in configuration files: ``{effect: name, setting: {…}, sizes: {…}}``, SI units.

What was learned may state its ``domain`` besides (``domain``).
"""

from collections.abc import Mapping
from dataclasses import replace
from math import inf
from typing import Any

from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.effects.domain import Domain
from stepdiag_ros.metrology.effects.effect import ActiveEffect, Effect, Setting
from stepdiag_ros.metrology.effects.learned_shape import Learned, quantities
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.spelling import nearest, suggestion


def active_effect(section: Section, catalogue: Mapping[str, Effect]) -> ActiveEffect:
    """Read an effect, its setting and its sizes; a size that is left out is zero.

    Args:
        section: a mapping with the keys ``effect``, ``setting`` and ``sizes``.
        catalogue: of effects, by name.

    Raises:
        ValueError: names the file, the key, what is wrong and what is expected.
    """
    effect = _known(section, catalogue)
    part = section.section("setting")
    setting = {key.name: _setting_value(part, key.name, key.kind) for key in effect.keys}
    part.finish()
    if isinstance(effect, Learned):
        effect = _within(effect, setting, section)
    part = section.section("sizes")
    given = part.keys()
    # A typical size is a standard deviation; any other size may act either way.
    limit = {"low": 0.0} if effect.typical else {}
    sizes = {size.name: part.number(size.name, default=0.0, **limit) for size in effect.sizes}
    part.finish()
    if not given:
        names = ", ".join(size.name for size in effect.sizes)
        raise Refusal(
            f"{part.source}: '{effect.name}' needs a size; give one of {names}", fault="missing"
        )
    return ActiveEffect(effect, setting, sizes)


def _known(section: Section, catalogue: Mapping[str, Effect]) -> Effect:
    name = section.text("effect")
    if name in catalogue:
        return catalogue[name]
    near = nearest(name, catalogue)
    raise Refusal(
        f"{section.source}: 'effect' is '{name}'; {suggestion(near, 'no such effect is known.')} An"
        f" effect of your own must be installed (pip install). Known: {', '.join(catalogue)}",
        fault="unknown",
        about="effect",
        where=section.source,
    )


def as_mapping(active: ActiveEffect) -> dict[str, Any]:
    """Return what ``active_effect`` reads the same effect from; YAML and JSON can write it."""
    return {
        "effect": active.effect.name,
        "setting": dict(active.setting),
        **_domain_of(active.effect),
        "sizes": {name: float(size) for name, size in active.sizes.items()},
    }


def _within(effect: Learned, setting: Setting, section: Section) -> Learned:
    """Return what was learned with the domain that its entry states, if it states one."""
    names = quantities(str(setting["shape"]))
    if section.unknown("domain"):
        return effect
    return replace(effect, domain=Domain.from_section(section.section("domain"), names))


def _domain_of(effect: Effect) -> dict[str, Any]:
    if not isinstance(effect, Learned) or effect.domain is None:
        return {}
    return {"domain": effect.domain.to_mapping()}


def _setting_value(section: Section, name: str, kind: type | tuple[str, ...]) -> Any:
    if isinstance(kind, tuple):
        return section.names(name, kind)[0]
    if kind is int:
        return section.integer(name, low=0, high=10**9)
    if kind is float:
        return section.number(name, low=1e-12, high=inf)
    return section.text(name)
