"""The catalogue's effects against the same effects written again, on an exact machine."""

import numpy as np
import pytest
from blind_cases import Machine, draw_case, write_case
from blind_harness import catalogue_entries, sizes_in_their_words
from blind_physics import INSIDE, draw_hidden
from blind_words import means

UNITS = {"growth_in_time": 1.0 / 3600.0, "drift": 1.0 / 3600.0, "reading_drift": 1.0 / 3600.0}
"""Of the generator's sizes that are told per hour, in the catalogue's SI unit; else 1."""


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    from stepdiag_ros.bags.table import load_table
    from stepdiag_ros.metrology.effects.stops import stops_of

    case = draw_case("one", 1)
    folder = write_case(tmp_path_factory.mktemp("case"), case, (0.0,))
    machine = Machine(1, case.plan)
    machine.approach[:] = 0.0
    stops = stops_of(load_table(folder / "run.csv").measurement)
    return machine, machine.run(), stops, catalogue_entries(stops)


@pytest.mark.parametrize("kind", INSIDE)
def test_an_effect_of_the_catalogue_does_what_its_physics_says(kind, measured):
    machine, run, stops, entries = measured
    setups = [(one.kind, one.line, one.order) for one in machine.plan.setups]
    hidden = draw_hidden(np.random.default_rng(0), kind, run)
    change = machine.signature(run, hidden)
    told = [
        sizes_in_their_words(change, effect, setting, stops, run)
        for entry, effect, setting in entries
        if means(entry, kind, hidden.setting, setups)
    ]
    sizes = [list(one.values()) for one in told if one]
    assert sizes, f"nothing in the catalogue does what {hidden} does"
    # Of the first size just the hidden one, in sign and unit, and nothing of the others.
    expected = [UNITS.get(kind, 1.0)]
    for one in sizes:
        wanted = expected + [0.0] * (len(one) - 1)
        np.testing.assert_allclose(one, wanted, atol=3e-3 * expected[0])
