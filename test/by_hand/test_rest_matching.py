"""The matching is the cheapest there is, and its margins are what other matchings cost more."""

from itertools import combinations, pairwise

import numpy as np
import pytest
from refused import refused

from stepdiag_ros.configuration import load_plan
from stepdiag_ros.metrology import rest_matching
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.rest_matching import (
    BREAK,
    EXTRA,
    JUNK,
    MISFIT,
    MISSING,
    OUTSIDE,
    SETUP,
    SURE,
    StopPlace,
    Tolerance,
    match,
    places_of,
    same_level,
)
from stepdiag_ros.metrology.stillness import Rest

TOLERANCE = Tolerance(part=0.02, least=1e-4, most=3e-3)


def rests_at(*levels, zeros=None):
    return [
        Rest(n * 10, n * 10 + 5, level, level, 1e-7, 100, zeros[n] if zeros else 0)
        for n, level in enumerate(levels)
    ]


def line(*displacements, setup=0):
    return [StopPlace(setup, float(d), ((setup, n),)) for n, d in enumerate(displacements)]


def cost_of(pairs, places, rests, before, after):
    """Cost of a matching within one setup, straight from its definition."""
    half = 0.5 * min(SETUP, 0.5 * len(places))
    (first_rest, first_place), (last_rest, last_place) = pairs[0], pairs[-1]
    cost = 2.0 * half + before[0] * first_rest + before[1] * first_place
    cost += after[0] * (len(rests) - 1 - last_rest) + after[1] * (len(places) - 1 - last_place)
    for (i, k), (j, m) in pairwise(pairs):
        a, b = rests[i], rests[j]
        nominal = places[m].displacement - places[k].displacement
        off = abs(b.arrived - a.left - nominal) / float(TOLERANCE.of(nominal))
        between = sum(
            JUNK if same_level(a, r, TOLERANCE) or same_level(b, r, TOLERANCE) else EXTRA
            for r in rests[i + 1 : j]
        )
        unchecked = BREAK + EXTRA * (j - i - 1)
        checked = between + MISFIT * off**2 if a.zero == b.zero and off <= 1.0 else np.inf
        cost += min(checked, unchecked) + MISSING * (m - k - 1)
    return cost


def every_matching(places, rests):
    for count in range(1, min(len(places), len(rests)) + 1):
        for i in combinations(range(len(rests)), count):
            for k in combinations(range(len(places)), count):
                yield tuple(zip(i, k, strict=True))


@pytest.mark.parametrize("goes_on", [False, True])
@pytest.mark.parametrize("begins_here", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_no_other_matching_costs_less_and_the_margins_are_right(seed, begins_here, goes_on):
    rng = np.random.default_rng(seed)
    places = line(*np.cumsum(rng.choice([0.0, 0.01, 0.01, 0.02, -0.01], 5)))
    kept = np.flatnonzero(rng.random(5) < 0.8)
    levels = [places[n].displacement + rng.normal(0.0, 3e-5) for n in kept]
    for _ in range(int(rng.integers(0, 3))):
        levels.insert(int(rng.integers(0, len(levels) + 1)), float(rng.normal(0.0, 0.02)))
    levels = levels or [0.0]
    zeros = np.cumsum(rng.random(len(levels)) < 0.1).tolist()
    rests = rests_at(*levels, zeros=zeros)
    before = (OUTSIDE if begins_here else JUNK, MISSING)
    after = (OUTSIDE, 0.0) if goes_on else (JUNK, MISSING)
    costs = {
        pairs: cost_of(pairs, places, rests, before, after)
        for pairs in every_matching(places, rests)
    }
    best = min(costs.values())
    found = match(places, rests, TOLERANCE, begins_here=begins_here, goes_on=goes_on)
    pairs = tuple((one.rest, one.place) for one in found)
    assert costs[pairs] == pytest.approx(best)
    for number, one in enumerate(found):
        low = found[number - 1].rest + 1 if number else 0
        high = found[number + 1].rest if number + 1 < len(found) else len(rests)
        others = [
            cost
            for other, cost in costs.items()
            if any(
                (i == one.rest and k != one.place)
                or (
                    k == one.place
                    and i != one.rest
                    and not (low <= i < high and same_level(rests[one.rest], rests[i], TOLERANCE))
                )
                for i, k in other
            )
        ]
        assert one.margin == pytest.approx(min(others, default=np.inf) - best)


def test_a_whole_line_is_sure():
    found = match(line(0.0, 0.01, 0.02, 0.03), rests_at(5.0, 5.01, 5.02, 5.03), TOLERANCE)
    assert [(one.rest, one.place) for one in found] == [(n, n) for n in range(4)]
    assert all(one.margin >= SURE for one in found)


def test_in_equal_steps_a_lack_of_one_stop_at_an_end_is_not_sure():
    found = match(line(0.0, 0.01, 0.02, 0.03, 0.04), rests_at(0.0, 0.01, 0.02, 0.03), TOLERANCE)
    assert all(one.margin == pytest.approx(0.0) for one in found)


def test_in_unequal_steps_it_is():
    found = match(line(0.0, 0.01, 0.03, 0.06, 0.08), rests_at(0.0, 0.02, 0.05, 0.07), TOLERANCE)
    assert [(one.rest, one.place) for one in found] == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert all(one.margin >= SURE for one in found)


def test_a_gap_in_the_middle_is_no_shift():
    found = match(line(*(0.01 * n for n in range(7))), rests_at(0, 0.01, 0.02, 0.04, 0.05, 0.06),
                  TOLERANCE)  # fmt: skip
    assert [one.place for one in found] == [0, 1, 2, 4, 5, 6]
    assert all(one.margin >= SURE for one in found)


def test_which_of_two_equal_setups_is_missing_is_not_sure():
    one = [0.0, 0.01, 0.02, 0.03, 0.04]
    found = match([*line(*one), *line(*one, setup=1)], rests_at(*one), TOLERANCE)
    assert all(pair.margin < SURE for pair in found)


def test_places_where_one_line_ends_and_the_next_begins_are_shared():
    plan = load_plan("demo")[0]
    places = places_of(plan, range(4))
    assert len(places) == 4 * 12 + 1
    assert places[12].stops == ((0, 12), (1, 0))
    assert max(place.displacement for place in places) == pytest.approx(0.12)
    assert {place.setup for place in places_of(plan, range(8))} == {0, 1}
    # A line that is looked for alone shares nothing with one that is not.
    assert next(place.stops for place in places_of(plan, [1])) == ((1, 0),)


def test_too_much_for_one_recording_is_refused(monkeypatch):
    monkeypatch.setattr(rest_matching, "_MOST_CELLS", 10)
    with refused(Refusal, "too_many"):
        match(line(0.0, 0.01, 0.02, 0.03), rests_at(0.0, 0.01, 0.02), TOLERANCE)
