"""Where a gap is, in words: gaps of known place are added to simulated runs, and the words tell it.

The gaps are written here by hand, stop by stop, and are none of the catalogue's effects; the
catalogue has a single effect that fits none of them.
"""

from dataclasses import replace

import numpy as np
import pytest
from cells_for_tests import make_cell, make_plan

from stepdiag_ros.metrology.cell import WeatherModel
from stepdiag_ros.metrology.discrepancy import CONSISTENT, DESCRIBED, UNEXPLAINED, diagnose
from stepdiag_ros.metrology.effects.dead_path_pressure import EFFECT as UNRELATED
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.simulation import simulate

NOISE = 0.1e-6
WARMING = WeatherModel(air_temperature_wave=0.5, wave_period=150.0)


@pytest.fixture(scope="module")
def quiet():
    """A run that lacks nothing: linear lines and four diagonals, both ways, twice."""
    plan = make_plan(repeats=2, directions=("forward", "backward"), orders=("XYZ", "YZX"))
    run = simulate(plan, replace(make_cell(noise=NOISE), weather=WARMING), seed=4)
    return replace(run, lines=tuple(_warmed(line) for line in run.lines))


def _warmed(line):
    """Return a line whose material is not warmed evenly, else time and temperature were one."""
    environment = line.environment.copy()
    environment[:, 3] = 20.0 + 0.5 * np.sin(line.time / 60.0)
    return replace(line, environment=environment)


def _with(measurement, gap):
    """Return the run with a gap added to its readings; ``gap`` gets all stops."""
    added = gap(stops_of(measurement))
    ends = np.cumsum([len(line.time) for line in measurement.lines])[:-1]
    lines = tuple(
        replace(line, displacement=line.displacement + part)
        for line, part in zip(measurement.lines, np.split(added, ends), strict=True)
    )
    return diagnose(replace(measurement, lines=lines), catalogue=[UNRELATED])


def _names(stops):
    return np.array([line.name for line in stops.lines])[stops.pass_index]


def _way(stops, axis):
    return (stops.position - stops.start)[:, axis] / stops.travel[axis]


def _backward(stops):
    return np.array([line.direction == "backward" for line in stops.lines])[stops.pass_index]


def _passed(stops):
    return (stops.time - stops.time[0]) / np.ptp(stops.time)


JUMPED = "npp XYZ backward, repeat 0"
GAPS = {
    "the Y moves of pnp and ppn, growing with time": lambda s: (
        20e-6 * np.isin(_names(s), ["pnp", "ppn"]) * _way(s, 1) * _passed(s)
    ),
    "the Z moves of ppp, growing with time": lambda s: (
        20e-6 * (_names(s) == "ppp") * _way(s, 2) * _passed(s)
    ),
    "the X moves, growing with the material temperature": lambda s: (
        10e-6 * s.direction[:, 0] * s.share[:, 0] * (s.material_temperature - 20.0)
    ),
    "whole passes, growing with the air temperature": lambda s: 1e-6 * (s.air_temperature - 20.0),
    "whole passes of npp, opposite forward and backward": lambda s: (
        0.5e-6 * (_names(s) == "npp") * np.where(_backward(s), -1.0, 1.0)
    ),
    "the stops right after a move of Z of z and pnp, the same in every pass": lambda s: (
        0.5e-6 * np.isin(_names(s), ["z", "pnp"]) * s.moved[:, 2]
    ),
    "whole passes, different from repeat to repeat": lambda s: (
        0.5e-6 * np.array([line.repeat for line in s.lines])[s.pass_index]
    ),
    f"all that its setup measured from stop 9 of {JUMPED} on, shifted by one jump": (
        lambda s: 0.8e-6 * _after(s, JUMPED, 9)
    ),
}


def _after(stops, words, number):
    index = [str(line) for line in stops.lines].index(words)
    first = np.flatnonzero((stops.pass_index == index) & (stops.number == number))[0]
    same = stops.setup == stops.setup[first]
    return 1.0 * (same & (stops.time >= stops.time[first]))


@pytest.mark.parametrize("words", GAPS)
def test_the_words_tell_the_place_of_the_gap(quiet, words):
    found = _with(quiet, GAPS[words])
    assert found.verdict in (UNEXPLAINED, DESCRIBED)
    assert found.patterns[0].words == words
    assert f"The gap is in {words} (" in found.where[0]
    if found.verdict == UNEXPLAINED:
        # Nothing explains it, so that it is still there after the search for names.
        assert found.patterns_after[0].words == words


def test_a_swing_is_told_with_its_direction_and_about_its_period(quiet):
    found = _with(
        quiet, lambda s: 0.5e-6 * s.direction[:, 1] * np.sin(0.4 + 2.0 * np.pi * s.time / 91.0)
    )
    look = found.patterns[0]
    assert look.place == "whole passes, as far as they go along Y"
    assert look.with_what.startswith("swinging with a period of about ")
    assert float(look.with_what.split()[-2]) == pytest.approx(91.0, rel=0.15)
    # Sine and cosine: as many values as had to be fitted.
    assert look.columns == 2


def test_two_places_are_told_one_after_another(quiet):
    first, second = list(GAPS)[1], list(GAPS)[4]
    found = _with(quiet, lambda stops: GAPS[first](stops) + GAPS[second](stops))
    assert {look.words for look in found.patterns[:2]} == {first, second}
    assert all(any(words in text for text in found.where) for words in (first, second))


def test_size_and_share_of_a_pattern_are_those_of_the_gap(quiet):
    found = _with(quiet, GAPS["whole passes of npp, opposite forward and backward"])
    look = found.patterns[0]
    assert look.lines == ("npp",)
    assert look.place == "whole passes"
    assert look.with_what == "opposite forward and backward"
    # Half of a micrometre less what zeros and curves take.
    assert 0.3e-6 < look.rms < 0.55e-6
    assert 0.8 < look.share <= 1.0
    assert look.p_value < 1e-6
    lost = found.chi_squared_before - look.gain
    assert lost == pytest.approx(found.degrees_of_freedom_before, rel=0.25)


def test_a_run_that_lacks_nothing_has_no_pattern(quiet):
    found = _with(quiet, lambda stops: np.zeros(len(stops.time)))
    assert found.verdict == CONSISTENT
    assert found.patterns == found.patterns_after == ()
    assert found.where == ()


@pytest.mark.parametrize("seed", range(6))
def test_noise_alone_has_no_pattern(seed):
    from stepdiag_ros.metrology.discrepancy.baseline import fit_baseline, whitened
    from stepdiag_ros.metrology.discrepancy.patterns import patterns

    plan = make_plan(repeats=2, directions=("forward", "backward"), orders=("XYZ", "YZX"))
    run = simulate(plan, replace(make_cell(noise=NOISE), weather=WARMING), seed=seed)
    stops = stops_of(run)
    problem = whitened(fit_baseline(run, stops), NOISE, 0.0)
    none = np.zeros((len(problem.gap), 0))
    assert patterns(problem, problem.gap, none, stops, 200.0) == ()


def test_the_map_has_every_way_of_splitting_and_blocks_count_from_the_lines_start(quiet):
    def late(stops):
        """Return a gap in the fifth block of every diagonal: each axis stands between 4 and 5."""
        middle = np.all((stops.position - stops.start != 0.0) | (stops.moved != 0.0), axis=1)
        share = np.abs(_way(stops, 0)) + np.abs(_way(stops, 1)) + np.abs(_way(stops, 2))
        return 1e-6 * (middle & (share > 2.0 + 1e-6) & (share < 2.5 + 1e-6)) * (_backward(stops))

    found = _with(quiet, late)
    splits = {share.split for share in found.map}
    assert splits >= {
        "line",
        "setup",
        "pass",
        "moved axis",
        "moved axis and line",
        "block",
        "direction",
        "repeat",
        "time",
        "material temperature",
        "air temperature",
        "place along the line",
    }
    blocks = {share.part: share.rms for share in found.map if share.split == "block"}
    assert list(blocks) == ["1", "2", "3", "4", "5", "6"]
    assert max(blocks, key=blocks.get) == "5"
    for split in ("line", "direction", "repeat", "pass", "time"):
        parts = [share for share in found.map if share.split == split]
        assert sum(share.readings for share in parts) == len(found.stops.time)
