"""The catalogue's effects against the same effects written again, on an exact machine."""

from dataclasses import replace

import numpy as np
import pytest
from blind_asking import entries_of
from blind_cases import draw_case, write_case
from blind_effects import INSIDE, UNSEEN, draw_hidden
from blind_harness import sizes_in_their_words
from blind_machine import Machine
from blind_words import means
from blind_yardstick import Yardstick

UNITS = {"growth_in_time": 1.0 / 3600.0, "drift": 1.0 / 3600.0, "reading_drift": 1.0 / 3600.0}
"""Of the generator's sizes that are told per hour, in the catalogue's SI unit; else 1."""
SEVERAL = {
    "curved_angular": lambda setting: [1.0, setting["bend"]],
    "wavy_angular": lambda setting: {
        1: [0.0, np.cos(setting["phase"]), np.sin(setting["phase"]), 0.0, 0.0],
        2: [0.0, 0.0, 0.0, np.cos(setting["phase"]), np.sin(setting["phase"])],
    }[setting["waves"]],
}
"""Kinds of which the catalogue tells several sizes → those."""
LIGHT = "nonlinearity"
"""Its phase is told by the readings, which the noise of this run blurs."""


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    from stepdiag_ros.bags.table import load_table
    from stepdiag_ros.metrology.effects.stops import stops_of

    case = draw_case("one", 3, largest=1000)
    folder = write_case(tmp_path_factory.mktemp("case"), case, (0.0,))
    machine = Machine(3, case.plan)
    machine.approach[:] = 0.0
    stops = stops_of(load_table(folder / "run.csv").measurement)
    return machine, machine.run(), stops, entries_of(stops)


@pytest.mark.parametrize("kind", [one for one in (*INSIDE, *UNSEEN) if one not in (LIGHT, "abbe")])
def test_an_effect_of_the_catalogue_does_what_its_physics_says(kind, measured):
    machine, run, stops, entries = measured
    setups = [(one.kind, one.line, one.order) for one in machine.plan.setups]
    hidden = draw_hidden(np.random.default_rng(0), kind, run)
    meant = [one for one in entries if means(one[0], kind, hidden.setting, setups)]
    if "constant" in hidden.setting:
        # The catalogue tries time constants of its own; any of them will do here.
        told = [one[0].setting.get("time_constant_s") for one in meant]
        constant = next(one for one in told if one)
        hidden = replace(hidden, setting={**hidden.setting, "constant": constant})
    change = machine.signature(run, hidden)
    told = [
        sizes_in_their_words(change, effect, setting, stops, run) for _, effect, setting in meant
    ]
    sizes = [list(one.values()) for one in told if one]
    if kind in SEVERAL:
        expected = SEVERAL[kind](hidden.setting)
        sizes = [one for one in sizes if len(one) == len(expected)]
    else:
        # Of the first size just the hidden one, in sign and unit, and nothing of the others.
        expected = [UNITS.get(kind, 1.0)]
    assert sizes, f"nothing in the catalogue does what {hidden} does"
    for one in sizes:
        wanted = [*expected, *([0.0] * (len(one) - len(expected)))]
        if kind == "mirror_tilt":
            # Two tilts across the beam; the catalogue's perpendiculars are its own.
            one, wanted = [float(np.hypot(*one))], [1.0]
        np.testing.assert_allclose(one, wanted, atol=5e-3 * max(np.abs(wanted)))


def test_the_catalogue_s_abbe_offset_is_that_of_a_mirror_mounted_elsewhere(measured):
    machine, run, stops, entries = measured
    setups = [(one.kind, one.line, one.order) for one in machine.plan.setups]
    hidden = draw_hidden(np.random.default_rng(0), "abbe", run)
    ((_, effect, setting),) = [
        one for one in entries if means(one[0], "abbe", hidden.setting, setups)
    ]
    # The roll that all mirrors see is one with straightness: it is taken off with the baseline.
    yardstick = Yardstick(run)
    seen = yardstick.signature(machine.signature(run, hidden))
    column = yardstick.signature(effect.columns(setting, stops)[:, 0])
    size = float(column @ seen / (column @ column))
    assert size == pytest.approx(1.0, abs=1e-3)
    assert np.linalg.norm(seen - size * column) < 5e-3 * np.linalg.norm(seen)
