"""Effects in a simulated cell: read from YAML, acting on the readings of a simulated run."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from cells_for_tests import make_cell, make_plan
from refused import refused

from stepdiag_ros.configuration import load_cell, load_plan
from stepdiag_ros.metrology.cell import SimulatedCell
from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.description import active_effect, as_mapping
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import simulate

SLIP = {
    "effect": "fringe slip",
    "setting": {
        "line": "ppp",
        "order": "XYZ",
        "repeat": 0,
        "direction": "backward",
        "from_stop": 2,
    },
    "sizes": {"size": 3.16e-7},
}
TURNS = {"effect": "several angular errors", "setting": {}, "sizes": {"size": 1e-5}}
BACKLASH = {"effect": "backlash", "setting": {"axis": "X"}, "sizes": {"lost_motion": 8e-7}}


def cell_with(*effects):
    mapping = yaml.safe_load(
        yaml.safe_dump({"chain": "YXZ", "errors": _travel(), "effects": [*effects]})
    )
    return SimulatedCell.from_mapping(mapping, "cell.yaml")


def _travel():
    return {"travel_low_m": [0.0, 0.0, 0.0], "travel_high_m": [0.1, 0.1, 0.1]}


@pytest.fixture(scope="module")
def plan():
    return make_plan(blocks=4, repeats=2, directions=("forward", "backward"))


def test_a_cell_without_effects_says_so():
    assert cell_with().effects == ()
    assert make_cell().effects == ()


def test_every_effect_comes_back_from_yaml_as_it_was(plan):
    known = catalogue()
    stops = stops_of(simulate(plan, replace(make_cell(), weather=_weather())))
    tried = set()
    for effect in known.values():
        for setting in list(effect.settings(stops))[:3]:
            sizes = {size.name: 0.25 * size.high for size in effect.sizes}
            active = ActiveEffect(effect, setting, sizes)
            text = yaml.safe_dump(as_mapping(active))
            section = Section(yaml.safe_load(text), "cell.yaml")
            read = active_effect(section, known)
            section.finish()
            assert read == ActiveEffect(known[effect.name], setting, sizes), effect.name
            assert effect.label(read.setting) == effect.label(setting)
            tried.add(effect.name)
    assert len(tried) >= 28


def _weather():
    weather = make_cell().weather
    return replace(
        weather,
        air_temperature_drift=1e-4,
        air_pressure_drift=0.01,
        relative_humidity=0.3,
        material_temperature_drift=5e-5,
    )


@pytest.mark.parametrize(
    ("entry", "reason"),
    [
        ({**BACKLASH, "effect": "backlsh"}, "did you mean 'backlash'"),
        ({**BACKLASH, "setting": {}}, "setting: 'axis' is missing"),
        ({**BACKLASH, "setting": {"axis": "W"}}, "'axis' is 'W'; expected one of X, Y, Z"),
        ({**BACKLASH, "setting": {"axis": "X", "a": 1}}, "unknown key 'a'"),
        ({**BACKLASH, "sizes": {}}, "'backlash' needs a size; give one of lost_motion"),
        ({**BACKLASH, "sizes": {"lost_motion": "much"}}, "'lost_motion' is 'much'"),
        ({**BACKLASH, "sizes": {"lostmotion": 1e-6}}, "did you mean 'lost_motion'"),
        ({**BACKLASH, "note": "hello"}, "unknown key 'note'"),
        (TURNS, "cannot be simulated; give the errors themselves under errors (curves E_AX to"),
        ({**TURNS, "sizes": {"size": -1e-5}}, "'size' is -1e-05"),
        ({**SLIP, "setting": {**SLIP["setting"], "from_stop": -1}}, "a whole number from 0"),
    ],
)
def test_a_wrong_entry_is_refused_by_its_key(entry, reason):
    with refused(Refusal, None, "cell.yaml", "effects[0]") as caught:
        cell_with(entry)
    assert reason in str(caught.value)


def test_a_simulated_run_differs_by_the_signatures_of_the_effects(plan):
    bare = simulate(plan, cell_with(), seed=4)
    made = simulate(plan, cell_with(BACKLASH, SLIP), seed=4)
    stops = stops_of(bare)
    expected = sum(
        catalogue()[entry["effect"]].columns(entry["setting"], stops)[:, 0] * size
        for entry, size in ((BACKLASH, 8e-7), (SLIP, 3.16e-7))
    )
    for setup in range(len(stops.setups)):
        # A setup's readings count from its first, what acts there included.
        rows = stops.setup == setup
        expected[rows] -= expected[rows][0]
    change = stops_of(made).displacement - stops.displacement
    assert change == pytest.approx(expected, abs=1e-15)
    assert np.ptp(change) > 8e-7
    assert all(
        line.displacement[0] == 0.0
        for line in made.lines
        if str(line.line).endswith("forward, repeat 0")
    )


def test_an_effect_that_cannot_act_in_the_plan_is_refused(plan):
    elsewhere = {**SLIP, "setting": {**SLIP["setting"], "line": "npp", "repeat": 7}}
    with refused(Refusal, "not_found", "npp", "XYZ", "7"):
        simulate(plan, cell_with(elsewhere))


def test_the_truth_of_the_curves_leaves_effects_out(plan):
    with_effects, without = cell_with(BACKLASH), cell_with()
    for name, curve in with_effects.truth(plan.volume).items():
        assert curve == pytest.approx(without.truth(plan.volume)[name], abs=0.0)


def test_the_shipped_cell_hides_backlash():
    cell, _ = load_cell("hidden_backlash")
    demo, _ = load_cell("demo")
    assert demo.effects == ()
    (active,) = cell.effects
    assert active.effect.label(active.setting) == "backlash of X"
    plan, _ = load_plan("move_orders")
    bare = stops_of(simulate(plan, replace(cell, effects=())))
    hidden = stops_of(simulate(plan, cell))
    assert np.max(np.abs(hidden.displacement - bare.displacement)) > 0.2e-6
    assert replace(cell, name=demo.name, effects=()).seed == demo.seed


def test_a_size_beyond_what_is_plausible_is_refused_with_its_limits():
    for size, unit in ((1.0, "1 m"), (-6e-5, "-6e-05 m")):
        entry = {**BACKLASH, "sizes": {"lost_motion": size}}
        with refused(
            Refusal, "out_of_range", "'backlash'", unit, "5e-05 m", "cell.yaml", about="lost_motion"
        ):
            cell_with(entry)
    assert cell_with({**BACKLASH, "sizes": {"lost_motion": 5e-5}}).effects
