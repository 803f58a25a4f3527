"""A package of its own for an effect: module, test and pyproject.toml, for its author to edit.

The layout is that of ``docs/effects.md``. The module holds the formula that a model has learned, or
the example of that page; the test computes the formula once more by hand. What happens in the
machine is left empty: the catalogue refuses the effect until its author states it.
"""

import re
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from keyword import iskeyword

from stepdiag_ros.metrology.effects.domain import PLACES, Domain, Range
from stepdiag_ros.metrology.effects.learned_shape import (
    READING,
    SPOT,
    TIMES,
    LearnedShape,
    factors,
)
from stepdiag_ros.metrology.effects.learned_shape import quantities as quantities_of
from stepdiag_ros.metrology.expansion import REFERENCE_TEMPERATURE
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.model import MachineModel, ModelEffect
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.report.effect_example import example_of

_BOX = (0.0, 0.1)
"""Of a test where no domain is known, m."""
_NAME = "[a-z][a-z0-9]*(?:[ _-][a-z0-9]+)*"

_MODULE = '''"""{title}: replace this sentence by what happens in the machine."""

from collections.abc import Iterator, Mapping

import numpy as np

{imports}
{box}

class {kind}(Effect):
    """{title}: replace this sentence by what the effect moves, and how."""

    name = "{name}"
    sentence = ""  # to be stated: what happens in the machine, for an engineer
    source = "{source}"
    sizes = (Size("amplitude", "m", -100e-6, 100e-6, "where the first shape is 1"),){needs}

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield the one setting where the run moves {moved}."""
        if {condition}:
            yield {{}}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return what the effect does at each stop."""
        del setting
{made}


EFFECT = {kind}()
'''
_TEST = '''"""{title}: by hand, on a run that cannot show it, and hidden and named."""

from dataclasses import replace

import numpy as np

from {module} import EFFECT  # isort: skip

from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.discrepancy import NAMED, diagnose
from stepdiag_ros.metrology.effects import catalogue
{since}from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.simulation import planned_run, simulate

LOW = np.array({low})  # m, first corner of the box over which the shapes count
HIGH = np.array({high})
ERRORS = {{
    "travel_low_m": LOW.tolist(),
    "travel_high_m": HIGH.tolist(),
    "positioning_m": 2e-6,
    "straightness_m": 1e-6,
}}
MACHINE = {{
    "seed": 5,
    "chain": "YXZ",
    "reading_noise_m": 1e-7,
    "errors": ERRORS,
    "weather": {{"air_temperature_wave_K": 1.0, "material_temperature_wave_K": 1.0}},
}}
CELL = SimulatedCell.from_mapping(MACHINE, "cell")
LINEAR = {{"kind": "linear", "names": ["x", "y", "z"]}}
DIAGONALS = {{"kind": "step_diagonal", "names": ["ppp", "npp", "pnp", "ppn"], "orders": ["XYZ"]}}
SIZE = {size}  # m


def plan_of(*lines):
    """Return a plan over the box; that of both kinds of lines determines all error curves."""
    plan = {{
        "origin_m": LOW.tolist(),
        "step_m": ((HIGH - LOW) / 4).tolist(),
        "blocks": 4,
        "repeats": 2,
        "directions": ["forward", "backward"],
        "feed_m_per_s": 0.05,
        "lines": list(lines),
    }}
    return Plan.from_mapping(plan, "plan")


def run(*lines):
    """Return the stops of a run of these lines."""
    return stops_of(planned_run(plan_of(*lines), CELL))


def test_the_change_is_the_formula():
    """Compute the change once more by hand."""
    stops = run(DIAGONALS)
{places}    moved, reading = np.zeros((len(stops.time), 3)), np.zeros(len(stops.time))
{byhand}    expected = SIZE * (np.sum(stops.direction * moved, axis=1) + reading)
    assert np.ptp(expected) > 0.0
    change = EFFECT.change({{}}, {{"amplitude": SIZE}}, stops).readings(stops)
    np.testing.assert_allclose(change, expected, rtol=1e-9, atol=1e-15)


def test_it_is_tried_where_a_run_can_show_it():
    """Try it on a run that can show it alone."""
    assert list(EFFECT.settings(run(DIAGONALS))) == [{{}}]
{blind}

def test_it_is_named_where_it_is_hidden():
    """Hide the effect in a simulated machine; the diagnosis names it, with its size."""
    hidden = replace(CELL, effects=(ActiveEffect(EFFECT, {{}}, {{"amplitude": SIZE}}),))
    tried = {{**catalogue(), EFFECT.name: EFFECT}}
    measured = simulate(plan_of(LINEAR, DIAGONALS), hidden, seed=1)
    found = diagnose(measured, catalogue=tried.values())
    assert found.verdict == NAMED, (found.sentence, found.not_testable.get(EFFECT.label({{}})))
    (finding,) = found.findings
    assert finding.candidate.effect is EFFECT
    uncertainty = finding.standard_uncertainty["amplitude"]
    assert abs(finding.sizes["amplitude"] - SIZE) < 3.0 * uncertainty
    assert uncertainty < abs(SIZE) / 5.0
'''
_RECORD = """[build-system]
requires = ["setuptools>=68"]
build-backend = "setuptools.build_meta"

[project]
name = "{distribution}"
version = "0.1"
dependencies = ["stepdiag_ros"]

[project.entry-points."stepdiag_ros.effects"]
{module} = "{module}:EFFECT"

[tool.setuptools]
py-modules = ["{module}"]
"""
_BY_HAND: tuple[tuple[str, str], ...] = (
    (r"([xyz])\^(\d)", r"\1**\2"),
    (r"([xyz])>(.+)", r"np.maximum(\1 - \2, 0.0) / (1.0 - \2)"),
    (r"([xyz])<(.+)", r"np.maximum(\2 - \1, 0.0) / \2"),
    (r"([xyz])~(.+)", rf"np.exp(-0.5 * ((\1 - \2) / {SPOT}) ** 2)"),
    (r"sense ([xyz])", r"sense_\1"),
    (r"creep ([xyz]) (.+)s", r'sense_\1 * np.exp(-since_reversal(stops, "\1") / \2)'),
    (r"t\^(\d)", r"(stops.time / 3600.0) ** \1"),
    (r"start (.+)s", r"np.exp(-stops.time / \1)"),
    (
        r"from (.+)s to (.+)s",
        r"((stops.time >= \1) & (stops.time <= \2))",
    ),
    (r"(sin|cos) t/(.+)s", r"np.\1(2.0 * np.pi * stops.time / \2)"),
    (
        r"(material|air)\^(\d)",
        rf"(stops.\1_temperature - {REFERENCE_TEMPERATURE}) ** \2",
    ),
)
"""Factor of a shape (``learned_shape``) → the same in Python."""


@dataclass(frozen=True)
class _Term:
    """One shape of the formula; its weight is its part of the first amplitude."""

    acts_on: str
    shape: str
    weight: float


def package_of(
    name: str, known: Collection[str], model: MachineModel | None = None, source: str = ""
) -> dict[str, str]:
    """Return the files of a package for an effect: name → text.

    Args:
        name: of the effect, in small letters.
        known: names of the effects that are there.
        model: whose learned shapes are the formula; None: the example of ``docs/effects.md``.
        source: the model in words.

    Raises:
        ValueError: the name cannot be one or is taken, or the model holds no learned shape.
    """
    module = checked_name(name, known)
    words = " ".join(re.split("[ _-]", name))
    given = {
        "name": words,
        "title": words[0].upper() + words[1:],
        "module": module,
        "kind": "".join(part.capitalize() for part in module.split("_")),
        "distribution": module.replace("_", "-"),
    }
    text, test = example_of(given) if model is None else _learned(model, source, given)
    return {
        f"{module}.py": text,
        f"test_{module}.py": test,
        "pyproject.toml": _RECORD.format(**given),
    }


def _learned(model: MachineModel, source: str, given: Mapping[str, str]) -> tuple[str, str]:
    """Return module and test of the learned shapes of a model."""
    effects = [one for one in model.effects if one.active.effect.learned]
    if not effects:
        raise Refusal(
            f"{source} holds no learned shape: 'stepdiag diagnose --extend' writes one for what"
            " it has DESCRIBED",
            fault="missing",
        )
    for one in effects:
        if not isinstance(one.active.effect, LearnedShape):
            raise Refusal(
                f"'{one.label}' turns an axis: write such an effect by hand, as docs/effects.md"
                " shows",
                fault="unsupported",
            )
    terms, domain = _terms(effects), _domain(effects)
    given = {**given, "size": repr(effects[0].active.sizes["amplitude"])}
    return _module(terms, domain, given, _source(effects)), _test(terms, domain, given)


def checked_name(name: str, known: Collection[str]) -> str:
    """Return the name of the module of an effect.

    Raises:
        ValueError: the name cannot be one, or is taken; one sentence.
    """
    if not re.fullmatch(_NAME, name) or len(name) > 60:
        raise Refusal(
            f"'{name}' cannot be the name of an effect: use small letters and digits, words"
            " separated by one blank, hyphen or underscore, at most 60 characters",
            fault="malformed",
            about="name",
        )
    module = re.sub("[ -]", "_", name)
    if module.replace("_", " ") in {re.sub("[ _-]", " ", one.lower()) for one in known}:
        raise Refusal(
            f"'{name}' is the name of an existing effect; choose another one",
            fault="twice",
            about="name",
        )
    # A folder of that name, which this command may have made, is a namespace without an origin.
    found = find_spec(module)
    taken = found is not None and found.origin is not None
    if iskeyword(module) or module in sys.stdlib_module_names or taken:
        raise Refusal(
            f"'{module}' is a word or a module of Python; choose another name",
            fault="twice",
            about="name",
        )
    return module


def _terms(effects: Sequence[ModelEffect]) -> list[_Term]:
    first = effects[0].active.sizes["amplitude"]
    if not first:
        raise Refusal(
            f"'{effects[0].label}' has no size in the model; give its amplitude", fault="missing"
        )
    return [
        _Term(
            str(one.active.setting["acts_on"]),
            TIMES.join(factors(str(one.active.setting["shape"]))),
            one.active.sizes["amplitude"] / first,
        )
        for one in effects
    ]


def _domain(effects: Sequence[ModelEffect]) -> Domain:
    """Return the places of all shapes: the box over which they count."""
    ranges: dict[str, Range] = {}
    for one in effects:
        domain = one.active.effect.domain if isinstance(one.active.effect, LearnedShape) else None
        for seen in () if domain is None else domain.ranges:
            if ranges.setdefault(seen.name, seen) != seen and seen.name in PLACES:
                raise Refusal(
                    f"the learned shapes count over different ranges of {seen.name[0]}: make an"
                    " effect of those of one run",
                    fault="mismatch",
                )
    return Domain(tuple(ranges.values()))


def _source(effects: Sequence[ModelEffect]) -> str:
    bag = effects[0].provenance.bag or "a run that the model does not name"
    return f"learned from {re.sub(r'[^A-Za-z0-9 .+_-]', '_', bag)}"


def _needed(terms: Sequence[_Term]) -> str:
    """Return the axes that must move for a run to show the effect, such as ``XYZ``."""
    text = " ".join(f"{one.acts_on * (one.acts_on != READING)} {_axes(one.shape)}" for one in terms)
    return "".join(letter for letter in AXES if letter in text)


def _axes(shape: str) -> str:
    return " ".join(
        letter for name in quantities_of(shape) for letter in AXES if letter in name.split("_")
    )


def _module(terms: Sequence[_Term], domain: Domain, given: Mapping[str, str], source: str) -> str:
    package = "from stepdiag_ros.metrology.effects"
    box = "".join(
        f'        Range("{one.name}", {one.low!r}, {one.high!r}),\n'
        for one in domain.ranges
        if one.name in PLACES
    )
    needed = _needed(terms)
    temperatures = [
        f'"{of}_temperature"' for of in ("material", "air") if any(of in one.shape for one in terms)
    ]
    senses = any(name.startswith("sense") for one in terms for name in quantities_of(one.shape))
    conditions = [f'{{*"{needed}"}} <= {{*stops.moving_axes}}'] if needed else []
    conditions += ["self.known(stops)"] if temperatures else []
    imports = [
        *([f"{package}.domain import Domain, Range"] if box else []),
        f"{package}.effect import Change, Effect, Setting, Size",
        f"{package}.learned_shape import product_of",
        f"{package}.stops import Stops",
    ]
    made = [*(["stops = BOX.counted(stops)"] if box else []), *_change(terms)]
    if box:
        box = f"\nBOX = Domain(  # m: the shapes count over it\n    (\n{box}    )\n)\n"
    return _MODULE.format(
        **given,
        source=source,
        imports="\n".join(imports),
        box=box,
        needs=(f"\n    needs = ({', '.join(temperatures)},)" if temperatures else "")
        + ("\n    depends_on_sense = True" if senses else ""),
        moved=" and ".join(needed) or "anything",
        condition=" and ".join(conditions) or "True",
        made="\n".join(f"        {line}" for line in made),
    )


def _change(terms: Sequence[_Term]) -> list[str]:
    """Return the lines that make the change by the formula."""
    made, parts = [], []
    for name, zeros, part in (
        ("moved", "(len(stops.time), 3)", "translation"),
        ("reading", "len(stops.time)", "reading"),
    ):
        own = [one for one in terms if (one.acts_on == READING) == (name == "reading")]
        if own:
            made.append(f"{name} = np.zeros({zeros})")
            made += [
                f'{_target(one)} += {_weight(one)}product_of("{one.shape}", stops)' for one in own
            ]
            parts.append(f'{part}=sizes["amplitude"] * {name}')
    return [*made, f"return Change({', '.join(parts)})"]


def _weight(term: _Term) -> str:
    return "" if term.weight == 1.0 else f"{term.weight!r} * "


def _target(term: _Term) -> str:
    return "reading" if term.acts_on == READING else f"moved[:, {AXES.index(term.acts_on)}]"


def _test(terms: Sequence[_Term], domain: Domain, given: Mapping[str, str]) -> str:
    ends = [domain.box().get(axis, _BOX) for axis in range(len(AXES))]
    texts = [text for one in terms for text in factors(one.shape)]
    places = []
    for axis, letter in enumerate("xyz"):
        if any(re.match(f"{letter}[^a-z]", text) for text in texts):
            share = f"(stops.corner + stops.position - LOW)[:, {axis}] / (HIGH - LOW)[{axis}]"
            places.append(f"{letter} = {share}")
        if any(re.match(f"(sense|creep) {letter}", text) for text in texts):
            places.append(f"sense_{letter} = stops.last_sense[:, {axis}]")
    byhand = []
    for one in terms:
        first, *others = (_by_hand(text) for text in factors(one.shape))
        byhand += [f"part = {first}", *(f"part = part * {other}" for other in others)]
        byhand.append(f"{_target(one)} += {_weight(one)}part")
    needed = _needed(terms)
    standing = next((letter for letter in AXES if {*needed} - {letter}), "")
    line = f'{{"kind": "linear", "names": ["{standing.lower()}"]}}'
    blind = f"    assert not list(EFFECT.settings(run({line})))\n"
    package = "from stepdiag_ros.metrology.effects.domain"
    return _TEST.format(
        **given,
        low=[low for low, _ in ends],
        high=[high for _, high in ends],
        places="".join(f"    {line}\n" for line in places),
        since=f"{package} import since_reversal\n" if "creep" in " ".join(texts) else "",
        byhand="".join(f"    {line}\n" for line in byhand),
        blind=blind if standing else "",
    )


def _by_hand(text: str) -> str:
    for pattern, python in _BY_HAND:
        if found := re.fullmatch(pattern, text):
            return found.expand(python)
    raise Refusal(f"'{text}' is not a factor of a learned shape", fault="unknown", about="shape")
