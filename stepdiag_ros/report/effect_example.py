"""Module and test of a package for an effect that no model describes: the example of the page.

Both are the files that ``docs/effects.md`` shows, with the names of the new effect. The example is
a swing along an axis, which no effect of the catalogue is; its author replaces it.
"""

from collections.abc import Mapping

_MODULE = '''"""{title}: replace this sentence by what happens in the machine."""

from collections.abc import Iterator, Mapping

import numpy as np

from stepdiag_ros.metrology.effects.effect import Change, Effect, Key, Setting, Size
from stepdiag_ros.metrology.effects.stops import Stops

# An example: a swing of the tool. Replace keys, sizes, settings and change by those of your
# effect, and the numbers of the test by ones that you have computed by hand.
AXES = ("X", "Y", "Z")
PERIODS = (240.0, 300.0, 360.0)  # s, those that are tried


class {kind}(Effect):
    """{title}: replace this sentence by what the effect moves, and how."""

    name = "{name}"
    sentence = ""  # to be stated: what happens in the machine, for an engineer
    source = ""  # to be stated: the document that describes the effect
    keys = (Key("axis", AXES), Key("period_s", float))
    sizes = (
        Size("sine", "m", -5e-6, 5e-6, "swing that begins with the run"),
        Size("cosine", "m", -5e-6, 5e-6, "swing that is largest as the run begins"),
    )

    def settings(self, stops: Stops) -> Iterator[Setting]:
        """Yield what is to be tried: every axis, every period of which the run sees two."""
        for axis in AXES:
            for period in PERIODS:
                if stops.duration > 2.0 * period:
                    yield {{"axis": axis, "period_s": period}}

    def change(self, setting: Setting, sizes: Mapping[str, float], stops: Stops) -> Change:
        """Return how far the tool is moved at each stop."""
        phase = 2.0 * np.pi * stops.time / setting["period_s"]
        swing = sizes["sine"] * np.sin(phase) + sizes["cosine"] * np.cos(phase)
        return Change.along(setting["axis"], swing)


EFFECT = {kind}()
'''
_TEST = '''"""{title}: by hand, on a run that cannot show it, and hidden and named."""

from dataclasses import replace

import numpy as np

from {module} import EFFECT  # isort: skip

from stepdiag_ros.configuration import load_cell
from stepdiag_ros.metrology.discrepancy import NAMED, diagnose
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.metrology.simulation import planned_run, simulate

CELL = load_cell("demo")[0]
SETTING = {{"axis": "Z", "period_s": 300.0}}
SIZES = {{"sine": 3e-6, "cosine": 2e-6}}  # m


def plan_with(dwell):
    """Return a plan that determines all nine error curves; dwell at each stop in s."""
    lines = [
        {{"kind": "linear", "names": ["x", "y", "z"]}},
        {{"kind": "step_diagonal", "names": ["ppp", "npp", "pnp", "ppn"], "orders": ["XYZ"]}},
    ]
    plan = {{
        "step_m": [0.02, 0.02, 0.02],
        "blocks": 4,
        "repeats": 2,
        "directions": ["forward", "backward"],
        "feed_m_per_s": 0.05,
        "sampling": {{"dwell_s": dwell}},
        "lines": lines,
    }}
    return Plan.from_mapping(plan, "plan")


def test_the_formula_by_hand():
    """Write down the swing at each quarter of the period; twice the size moves twice as far."""
    stops = stops_of(planned_run(plan_with(4.0), CELL))
    for time, moved in ((0.0, 2e-6), (75.0, 3e-6), (150.0, -2e-6), (225.0, -3e-6)):
        then = replace(stops, time=np.full(len(stops.time), time))
        change = EFFECT.change(SETTING, SIZES, then).readings(then)
        assert np.allclose(change, stops.direction[:, 2] * moved, rtol=0.0, atol=1e-12)
    change = EFFECT.change(SETTING, SIZES, stops).readings(stops)
    double = EFFECT.change(SETTING, {{name: 2.0 * size for name, size in SIZES.items()}}, stops)
    assert np.allclose(double.readings(stops), 2.0 * change)


def test_a_run_of_less_than_two_periods_cannot_show_it():
    """Try no setting on a run that cannot show it."""
    short = stops_of(planned_run(plan_with(0.6), CELL))
    assert short.duration < 2.0 * 240.0
    assert list(EFFECT.settings(short)) == []


def test_it_is_named_where_it_is_hidden():
    """Hide the effect in a simulated machine; the diagnosis names it, with its sizes."""
    hidden = replace(CELL, effects=(ActiveEffect(EFFECT, SETTING, SIZES),))
    tried = {{**catalogue(), EFFECT.name: EFFECT}}
    found = diagnose(simulate(plan_with(4.0), hidden, seed=1), catalogue=tried.values())
    assert found.verdict == NAMED, (found.sentence, found.not_testable.get(EFFECT.label(SETTING)))
    (finding,) = found.findings
    assert finding.candidate.effect is EFFECT
    assert finding.candidate.setting == SETTING
    for name, size in SIZES.items():
        uncertainty = finding.standard_uncertainty[name]
        assert abs(finding.sizes[name] - size) < 3.0 * uncertainty
        assert uncertainty < abs(size) / 5.0
'''


def example_of(given: Mapping[str, str]) -> tuple[str, str]:
    """Return the texts of the module and of its test.

    Args:
        given: ``title``, ``module``, ``kind`` (class) and ``name`` of the effect.
    """
    return _MODULE.format(**given), _TEST.format(**given)
