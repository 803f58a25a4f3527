"""The exchange of lines and their order, on a box of few blocks."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stepdiag_ros.configuration import load_machine, plan_from_text
from stepdiag_ros.metrology.geometry import SQUARENESS, TRANSLATIONS, beam_direction
from stepdiag_ros.metrology.plan import BACKWARD, FORWARD, LINEAR, STEP_DIAGONAL, Plan, Volume
from stepdiag_ros.metrology.plausible import Plausible
from stepdiag_ros.metrology.solvers import solve
from stepdiag_ros.planning.duration import Assumptions, duration
from stepdiag_ros.planning.exchange import Exchange
from stepdiag_ros.planning.expectation import nominal_measurement
from stepdiag_ros.planning.information import Information
from stepdiag_ros.planning.offers import StopNoise, lines_in, offers_of
from stepdiag_ros.planning.order import Order
from stepdiag_ros.planning.plan_text import plan_text

VOLUME = Volume((0.1, -0.05, 0.0), (0.08, 0.06, 0.05), 3)
MACHINE = replace(load_machine("demo")[0], growth_per_s=2e-9)
NAMES = (*TRANSLATIONS, *SQUARENESS)
NOISE = StopNoise(0.1e-6)


def search(paused, rotation=0.0, limits=None):
    conditions = Plan("test", VOLUME, (), 0.1, pause_for_setup=paused)
    conditions = replace(conditions, one_alignment_per_diagonal=True)
    offers = offers_of(
        lines_in(VOLUME, (LINEAR, STEP_DIAGONAL)),
        conditions,
        MACHINE,
        NOISE.of(conditions.sampling.window),
        (FORWARD, BACKWARD),
        Assumptions(),
    )
    information = Information(offers, VOLUME, "YXZ", Plausible(rotation), NAMES)
    return conditions, Exchange(information, limits or dict.fromkeys(NAMES, 0.1e-6), 5)


def corner_lines(exchange, count):
    """Return as many measurements of three linear lines and four diagonals as in most plans."""
    return [
        count * (not any(offer.line.offset) and offer.line.order in ("", "XYZ"))
        for offer in exchange.information.offers
    ]


@pytest.mark.parametrize("rotation", [0.0, 10e-6])
def test_the_frontier_has_a_plan_that_beats_the_usual_one(rotation):
    _, exchange = search(paused=True, rotation=rotation)
    usual = exchange.choice(corner_lines(exchange, 1))
    front = exchange.frontier()
    assert [one.seconds for one in front] == sorted(one.seconds for one in front)
    ratios = [one.ratio for one in front]
    assert ratios == sorted(ratios, reverse=True) and ratios[-1] < ratios[0]
    assert any(one.seconds <= usual.seconds and one.ratio <= usual.ratio for one in front)


def test_exchanges_keep_to_their_wish():
    _, exchange = search(paused=True)
    start = exchange.choice(corner_lines(exchange, 3))
    quicker = exchange.best_within(start, start.seconds)
    assert quicker.seconds <= start.seconds and quicker.ratio <= start.ratio
    _, wished = search(paused=True, limits=dict.fromkeys(NAMES, 1.05 * start.ratio * 0.1e-6))
    shortest = wished.shortest(wished.choice(start.counts))
    assert shortest.ratio <= 1.0 and shortest.seconds < start.seconds


def test_a_longer_stay_averages_the_readings_and_not_the_place():
    noise = StopNoise(0.1e-6, 0.2e-6)
    assert noise.of(1.0) ** 2 == pytest.approx(0.05e-12)
    assert noise.of(1e6) == pytest.approx(0.1e-6, rel=1e-3)


def grown(plan, lines):
    """Return the solved errors of a perfect machine whose axes grow, seen from the mean time."""
    now, stamped = 0.0, []
    ordered = replace(plan, lines=lines)
    nominal = nominal_measurement(ordered, NOISE.place)
    for line, taken in zip(nominal.lines, duration(ordered, MACHINE).lines, strict=True):
        now += taken.alignment + taken.positioning
        stamped.append((line, now + np.linspace(0.0, taken.moves + taken.dwells, len(line.time))))
        now += taken.moves + taken.dwells
    mean = np.mean([np.mean(stamps) for _, stamps in stamped])
    made = []
    for line, stamps in stamped:
        way = (line.target - VOLUME.origin) @ beam_direction(
            line.line.name, np.asarray(VOLUME.step)
        )
        more = MACHINE.growth_per_s * (stamps - mean) * way
        made.append(replace(line, displacement=line.displacement + more))
    result = solve(replace(nominal, lines=tuple(made), plausible=Plausible(0.0), chain="YXZ"))
    return max(abs(result.figure(name).value) for name in SQUARENESS)


def test_rounds_take_growth_out_of_squareness():
    conditions, exchange = search(paused=False)
    choice = exchange.choice(corner_lines(exchange, 4))
    ordered = Order(exchange, choice, VOLUME, MACHINE, paused=False).best()
    usual = tuple(
        line
        for offer, count in zip(exchange.information.offers, choice.counts, strict=True)
        for line in offer.passes(count)
    )
    assert sorted(map(str, ordered.lines)) == sorted(map(str, usual))
    assert grown(conditions, ordered.lines) < 0.1 * grown(conditions, usual)


@pytest.mark.parametrize("paused", [True, False])
def test_an_order_keeps_alignments_together_or_goes_in_rounds(paused):
    conditions, exchange = search(paused=paused)
    choice = exchange.choice(corner_lines(exchange, 3))
    ordered = Order(exchange, choice, VOLUME, MACHINE, paused).best()
    plan = replace(conditions, lines=ordered.lines)
    if paused:
        setups = [plan.setup_of(line) for line in plan.lines]
        assert sum(a != b for a, b in pairwise(setups)) == 6
    else:
        assert [line.repeat for line in plan.lines] == sorted(line.repeat for line in plan.lines)
    assert plan_from_text(plan_text(plan), "written") == plan
