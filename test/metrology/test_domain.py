"""Where a learned effect was seen: its ranges, what leaves them, and how files hold them."""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan
from refused import refused

from stepdiag_ros.metrology.checking import Section
from stepdiag_ros.metrology.effects.catalogue import catalogue
from stepdiag_ros.metrology.effects.description import active_effect, as_mapping
from stepdiag_ros.metrology.effects.domain import Domain, Range
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.learned_shape import (
    LearnedShape,
    outside,
    quantities,
    without_domain,
)
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.live_effects import check_measurable
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import planned_run

BOX = Domain((Range("X_m", 0.0, 0.06), Range("Z_m", -0.02, 0.04)))


def stops(blocks=6, origin=(0.0, 0.0, -0.02)):
    plan = make_plan(blocks=blocks, origin=origin, directions=("forward", "backward"))
    return stops_of(planned_run(plan, make_cell(low=(-0.1, -0.1, -0.1), high=(0.2, 0.2, 0.2))))


@pytest.mark.parametrize(
    ("shape", "names"),
    [
        ("x>0.5 * z^2", ("X_m", "Z_m")),
        ("sense y * x^1", ("sense_Y", "X_m")),
        ("creep x 40s", ("sense_X", "since_reversal_X_s")),
        ("start 600s * z~0.5", ("time_s", "Z_m")),
        ("sin t/300s", ("time_s",)),
        ("material^1 * air^2", ("material_temperature_degC", "air_temperature_degC")),
    ],
)
def test_only_that_on_which_a_shape_depends_is_in_its_domain(shape, names):
    assert quantities(shape) == names
    seen = stops()
    ranges = Domain.of(names, seen).ranges
    assert tuple(one.name for one in ranges) == names
    for one in ranges:
        if one.name == "time_s":
            assert (one.low, one.high) == (np.min(seen.time), np.max(seen.time))
        if one.name.startswith("sense"):
            assert (one.low, one.high) == (-1.0, 1.0)


def test_the_range_of_a_place_is_the_measured_box_in_machine_coordinates():
    (x, z) = Domain.of(("X_m", "Z_m"), stops()).ranges
    assert (x.low, x.high) == pytest.approx((0.0, 0.06))
    assert (z.low, z.high) == pytest.approx((-0.02, 0.04))


def test_a_shape_is_at_the_same_place_of_the_machine_in_any_box():
    effect = LearnedShape(BOX)
    setting, sizes = {"acts_on": "Y", "shape": "x>0.5 * z^1"}, {"amplitude": 2e-6}
    for seen in (stops(), stops(blocks=4, origin=(0.01, 0.0, -0.01))):
        x, z = (seen.corner + seen.position)[:, [0, 2]].T
        expected = 2e-6 * np.maximum(x / 0.03 - 1.0, 0.0) * (z + 0.02) / 0.06
        moved = effect.change(setting, sizes, seen).translation
        np.testing.assert_allclose(moved[:, 1], expected, atol=1e-18)


def test_what_leaves_a_domain_is_named():
    assert BOX.left_by(stops()) == ()
    assert BOX.left_by(stops(blocks=4)) == ()
    ((seen, here),) = BOX.left_by(stops(origin=(0.0, 0.0, -0.03)))
    assert seen.name == here.name == "Z_m" and here.low == pytest.approx(-0.03)
    assert "-20 to 40 mm" in seen.words


def test_a_run_outside_a_domain_is_told_of_for_models_and_cells():
    bent = ActiveEffect(LearnedShape(BOX), entry()["setting"], {"amplitude": 1e-6})
    bare = replace(bent, effect=LearnedShape())
    farther = stops(origin=(0.0, 0.0, -0.03))
    (said,) = outside([bent, bare], farther)
    assert "x^1 * z^1" in said and "-30 to 30 mm" in said and "X" not in said.split("over")[1]
    assert outside([bent, bare], stops()) == ()
    (unknown,) = without_domain([bent, bare])
    assert "no domain" in unknown
    cell = replace(make_cell(low=(-0.1, -0.1, -0.1), high=(0.2, 0.2, 0.2)), effects=(bent,))
    assert check_measurable(make_plan(origin=(0.0, 0.0, -0.03)), cell) == (said,)
    assert check_measurable(make_plan(origin=(0.0, 0.0, -0.02)), cell) == ()


def entry(**more):
    return {
        "effect": "learned shape",
        "setting": {"acts_on": "Y", "shape": "x^1 * z^1"},
        "sizes": {"amplitude": 1e-6},
        **more,
    }


def test_a_file_holds_a_domain():
    given = entry(domain=BOX.to_mapping())
    active = active_effect(Section(given, "file"), catalogue())
    assert active.effect.domain == BOX
    assert as_mapping(active) == given
    bare = active_effect(Section(entry(), "file"), catalogue())
    assert bare.effect.domain is None and as_mapping(bare) == entry()


@pytest.mark.parametrize(
    ("domain", "fault"),
    [
        ({"X_m": [0.0, 0.1]}, "missing"),
        ({"X_m": [0.1, 0.0], "Z_m": [0.0, 0.1]}, "malformed"),
        ({"X_m": [0.0, 0.0], "Z_m": [0.0, 0.1]}, "malformed"),
        ({"X_m": [0.0, 0.1], "Z_m": [0.0, 0.1], "Y_m": [0.0, 0.1]}, "unknown"),
        ({"X_m": [0.0], "Z_m": [0.0, 0.1]}, "malformed"),
    ],
)
def test_a_domain_that_is_none_is_refused(domain, fault):
    with refused(Refusal, fault):
        active_effect(Section(entry(domain=domain), "file"), catalogue())
