"""The model of a machine: what is taken as known of it, and where each piece of it comes from.

A model is what a measurement is compared with. It grows: an effect that a measurement has named is
added with its size, its uncertainty and the evidence for it, so that a later reader can go back to
the recorded run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from math import isfinite
from typing import Any

from stepdiag_ros.metrology.checking import UNKNOWN, Section
from stepdiag_ros.metrology.effects.description import active_effect, as_mapping
from stepdiag_ros.metrology.effects.effect import ActiveEffect, Effect
from stepdiag_ros.metrology.geometry import CHAINS, TRANSLATIONS
from stepdiag_ros.metrology.refusal import Refusal

FREE = "free"
FIXED, FITTED = "fixed", "fitted"
STATUSES = (FIXED, FITTED)
TOGETHER = " + "
"""Between the files, or their digests, of runs that were diagnosed together."""


@dataclass(frozen=True)
class Provenance:
    """Where an effect in a model comes from; empty texts where that is unknown.

    Attributes:
        bag: name of the file that holds the run; of several that were diagnosed together, with
            " + " between.
        sha256: of that file, 64 hexadecimal digits; joined in the same way.
        date: on which it was named, ISO 8601.
        evidence: in words and figures.
    """

    bag: str = ""
    sha256: str = ""
    date: str = ""
    evidence: str = ""


@dataclass(frozen=True)
class ModelEffect:
    """An effect that acts in the machine, as far as it is known.

    Attributes:
        active: the effect, its setting and its sizes, SI.
        standard_uncertainty: of each size, SI; NaN if unknown.
        status: ``fixed``: the sizes hold; ``fitted``: every run determines its own sizes.
        provenance: where it comes from.
        covariance: with effects that were learned together with it: label → covariance of the first
            sizes of both, SI.
    """

    active: ActiveEffect
    standard_uncertainty: Mapping[str, float]
    status: str = FIXED
    provenance: Provenance = field(default_factory=Provenance)
    covariance: Mapping[str, float] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Return which effect this is, for example ``backlash of X``."""
        return self.active.effect.label(self.active.setting)


@dataclass(frozen=True)
class MachineModel:
    """What is taken as known of a machine.

    Attributes:
        name: of the machine, in words; empty if it has none.
        chain: order of the axes from workpiece to tool, one of ``geometry.CHAINS``; empty if not
            known.
        curves: translations under their ISO 230-1 names at the nodes of the measured box, m, that
            are held fixed; empty if all are free.
        effects: that act beyond the curves.
    """

    name: str = ""
    chain: str = ""
    curves: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    effects: tuple[ModelEffect, ...] = ()

    @classmethod
    def from_mapping(
        cls, mapping: Mapping[str, Any], source: str, catalogue: Mapping[str, Effect]
    ) -> "MachineModel":
        """Make a model from the parsed YAML of a model file (layout in ``config/models``).

        Args:
            mapping: the parsed file; its keys are the attributes.
            source: what the user calls the file, for the text of an error.
            catalogue: of effects, by name.

        Raises:
            ValueError: names the source, the key, what is wrong and what is expected.
        """
        section = Section(mapping, source)
        chain = "" if section.unknown("chain") else section.names("chain", CHAINS)[0]
        name = section.text("name", default="")
        effects: tuple[ModelEffect, ...] = ()
        if mapping.get("effects") not in (None, [], ()):
            entries = section.sections("effects")
            effects = tuple(
                _effect(one, entry, catalogue)
                for one, entry in zip(entries, mapping["effects"], strict=True)
            )
        section.unknown("effects")
        curves = _curves(section, mapping.get("curves", FREE))
        section.finish()
        labels = [effect.label for effect in effects]
        for label in labels:
            if labels.count(label) > 1:
                raise Refusal(
                    f"{source}: '{label}' is there twice; add the sizes up in one", fault="twice"
                )
        return cls(name, chain, curves, effects)

    def to_mapping(self) -> dict[str, Any]:
        """Return what ``from_mapping`` makes the same model from; YAML and JSON can write it."""
        return {
            "name": self.name,
            "chain": self.chain or UNKNOWN,
            "curves": {name: list(values) for name, values in self.curves.items()} or FREE,
            "effects": [_effect_mapping(effect) for effect in self.effects],
        }

    def with_effects(self, added: Sequence[ModelEffect]) -> "MachineModel":
        """Return the model with these effects; each replaces one that the model has already."""
        new = {effect.label: effect for effect in added}
        kept = tuple(effect for effect in self.effects if effect.label not in new)
        return replace(self, effects=(*kept, *added))

    def of_status(self, status: str) -> tuple[ActiveEffect, ...]:
        """Return the effects of a status, ``fixed`` or ``fitted``."""
        return tuple(effect.active for effect in self.effects if effect.status == status)


def _curves(section: Section, given: Any) -> dict[str, tuple[float, ...]]:
    section.unknown("curves")
    if given == FREE:
        return {}
    if not isinstance(given, Mapping):
        raise Refusal(
            f"{section.source}: 'curves' is {given!r}; expected '{FREE}', or values in m at the"
            f" nodes of the measured box under the names {', '.join(TRANSLATIONS)}",
            fault="malformed",
            aspect="curves",
        )
    part = Section(given, f"{section.source}: curves")
    found = {name: part.numbers(name) for name in TRANSLATIONS if name in given}
    for name in given:
        if name not in TRANSLATIONS:
            raise Refusal(
                f"{part.source}: '{name}' is not a translation; use {', '.join(TRANSLATIONS)}",
                fault="unknown",
            )
    part.finish()
    for name, values in found.items():
        if len(values) < 2:
            raise Refusal(
                f"{part.source}: '{name}' needs a value for each node",
                fault="malformed",
                aspect="values",
            )
    return found


def _effect(
    section: Section, entry: Mapping[str, Any], catalogue: Mapping[str, Effect]
) -> ModelEffect:
    active = active_effect(section, catalogue)
    uncertain = section.section("standard_uncertainty")
    uncertainty = {
        size.name: float("nan")
        if uncertain.unknown(size.name)
        else uncertain.number(size.name, low=0.0)
        for size in active.effect.sizes
    }
    uncertain.finish()
    status = section.names("status", STATUSES, default=FIXED)[0]
    provenance = _provenance(section, entry)
    beside = section.section("covariance")
    covariance = {label: beside.number(label) for label in beside.keys()}  # noqa: SIM118
    section.finish()
    return ModelEffect(active, uncertainty, status, provenance, covariance)


def _provenance(section: Section, entry: Mapping[str, Any]) -> Provenance:
    part = section.section("provenance")
    given = entry.get("provenance", {})
    if isinstance(given, Mapping) and isinstance(given.get("date"), date):
        # YAML reads an unquoted date as one.
        given = {**given, "date": given["date"].isoformat()}
        part = Section(given, part.source)
    made = Provenance(
        **{name: part.text(name, default="") for name in ("bag", "sha256", "date", "evidence")}
    )
    part.finish()
    digits = set("0123456789abcdef")
    each = made.sha256.split(TOGETHER) if made.sha256 else []
    if any(len(one) != 64 or not set(one) <= digits for one in each):
        raise Refusal(
            f"{part.source}: 'sha256' is '{made.sha256}'; expected 64 hexadecimal digits, of"
            f" several files with '{TOGETHER}' between",
            fault="malformed",
        )
    return made


def _effect_mapping(effect: ModelEffect) -> dict[str, Any]:
    return {
        **as_mapping(effect.active),
        "standard_uncertainty": {
            name: float(value) if isfinite(value) else UNKNOWN
            for name, value in effect.standard_uncertainty.items()
        },
        "status": effect.status,
        "provenance": {name: text for name, text in vars(effect.provenance).items() if text},
        **({"covariance": dict(effect.covariance)} if effect.covariance else {}),
    }
