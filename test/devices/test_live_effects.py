"""Effects of a simulated cell, reading by reading, against the simulation of all stops at once."""

from dataclasses import replace
from functools import cache
from time import process_time

import numpy as np
import pytest
from cells_for_tests import make_cell
from live_cell import MS, START, LiveCell
from refused import refused

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.interferometer import FollowsRun
from stepdiag_ros.metrology.cell import DriveModel
from stepdiag_ros.metrology.effects import catalogue
from stepdiag_ros.metrology.effects.effect import ActiveEffect
from stepdiag_ros.metrology.effects.stops import stops_of
from stepdiag_ros.metrology.live_effects import LiveEffects
from stepdiag_ros.metrology.plan import Plan, Sampling
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.simulation import planned_run, read_again

NM = 1e-9
PLAN = Plan.from_mapping(
    {
        "step_m": [0.0103, 0.0121, 0.0083],
        "blocks": 2,
        "repeats": 2,
        "directions": ["forward", "backward"],
        "feed_m_per_s": 0.05,
        "lines": [
            {"kind": "linear", "names": ["x"]},
            {"kind": "step_diagonal", "names": ["npp"], "orders": ["YZX"]},
        ],
    },
    "plan",
)
CELL = make_cell(
    seed=5,
    high=(0.1,) * 3,
    rotation=5e-6,
    squareness=(0.0,) * 3,
    tilt=1e-4,
    mirror=2e-5,
    noise=0.0,
    mirror_offset_m=[0.02, -0.01, -0.1],
    weather={
        "air_temperature_drift_K_per_h": 20.0,
        "air_pressure_Pa": 99000.0,
        "air_pressure_drift_Pa_per_h": 500.0,
        "relative_humidity": 0.3,
        "material_warm_up_K": 2.0,
        "warm_up_time_s": 30.0,
    },
    held=0.0,
)
"""It has much weather, since the run takes less than a minute."""
BEFORE_RUN = 3.0
SLIP = {"line": "npp", "order": "YZX", "repeat": 0, "direction": "backward", "from_stop": 3}


def active(name, setting=None, **sizes):
    return ActiveEffect(catalogue()[name], setting or {}, sizes)


def with_effects(*effects):
    return replace(CELL, effects=effects)


@cache
def bare():
    return LiveCell(PLAN, CELL).measure()


@cache
def bare_and_broken():
    return broken(LiveCell(PLAN, CELL)).measure()


def true_weather(run):
    """The run with the air and material that were, not those that the sensors said last."""
    return replace(
        run,
        lines=tuple(
            replace(
                line,
                environment=np.array([CELL.environment(BEFORE_RUN + time) for time in line.time]),
            )
            for line in run.lines
        ),
    )


def at_once(run, cell):
    """What the effects of a cell add to a run that was made, all stops at once, m."""
    run = true_weather(run)
    return readings(read_again(run, cell)) - readings(read_again(run, CELL))


def readings(run):
    return stops_of(run).displacement


def spread(which):
    """Every eleventh setting or so of each effect of the catalogue, at half its largest sizes.

    Effects that are only a typical size are left out: they change no reading, and the file of a
    cell may not hold them.
    """
    stops = stops_of(planned_run(PLAN, CELL))
    acting = [effect for effect in catalogue().values() if not effect.typical]
    for number, effect in enumerate(acting):
        settings = list(effect.settings(stops))
        if settings:
            setting = settings[(11 * which + number) % len(settings)]
            yield ActiveEffect(effect, setting, {one.name: 0.5 * one.high for one in effect.sizes})


@pytest.mark.parametrize("which", range(4))
def test_live_readings_show_at_every_stop_what_the_effects_say(which):
    chosen = [one for number, one in enumerate(spread(which)) if number % 2 == which % 2]
    assert len(chosen) >= 14
    cell = with_effects(*chosen)
    run = LiveCell(PLAN, cell).measure()
    expected = at_once(run, cell)
    assert readings(run) - readings(bare()) == pytest.approx(expected, abs=0.1 * NM)
    for one in chosen:
        # None is so small that nobody would miss it.
        assert np.ptp(at_once(run, with_effects(one))) > 5 * NM, one.effect.name


def test_effects_of_the_whole_catalogue_were_tried():
    tried = {
        one.effect.name
        for which in range(4)
        for number, one in enumerate(spread(which))
        if number % 2 == which % 2
    }
    possible = {one.effect.name for one in spread(0)}
    assert tried == possible and len(possible) >= 29


def test_the_whole_reading_is_that_of_the_simulation_at_once():
    cell = with_effects(active("backlash", {"axis": "X"}, lost_motion=0.8e-6))
    run = LiveCell(PLAN, cell, rate=200.0).measure()
    # The drives come to rest and the sensors lag behind the air by a picometre or so.
    assert readings(run) == pytest.approx(readings(read_again(run, cell)), abs=1 * NM)
    assert np.ptp(at_once(run, cell)) > 0.4e-6


SEVERAL = with_effects(
    active("backlash", {"axis": "Y"}, lost_motion=2e-6),
    active("fringe slip", SLIP, size=0.6e-6),
    active("warm-up drift", {"along": "beam", "time_constant_s": 13.0}, final=1e-5),
    active("position-trigger delay", delay=1e-3),
)


@pytest.mark.parametrize("late", range(4))
def test_no_stop_depends_on_how_late_messages_are(late):
    prompt, held_up = LiveCell(PLAN, SEVERAL), LiveCell(PLAN, SEVERAL, late=late)
    runs = prompt.measure(), held_up.measure()
    assert np.array_equal(readings(runs[0]), readings(runs[1]))
    assert np.array_equal(stops_of(runs[0]).time, stops_of(runs[1]).time)
    streams = [
        np.array([(one.time - START, one.raw_displacement) for one in cell.readings])
        for cell in (prompt, held_up)
    ]
    assert len(streams[0]) > 3000
    # On the way, it may matter by which reading the last stop was left.
    assert streams[0] == pytest.approx(streams[1], abs=0.1 * NM, nan_ok=True)


def test_a_stop_that_settles_late_shows_the_effect_at_its_own_time():
    drive = DriveModel(settling_amplitude_m=5e-6, settling_time_s=0.12)
    slow = replace(CELL, drive=drive)
    impatient = Sampling(0.1, 0.0, 0.05, 3.0, 10 * NM, 10 * NM)
    plan = replace(PLAN, lines=PLAN.lines[:2], sampling=impatient)
    cell, still = (
        replace(slow, effects=(active("drift", {"along": "beam"}, m_per_s=speed),))
        for speed in (1e-7, 0.0)
    )
    live = LiveCell(plan, cell)
    run, without = live.measure(), LiveCell(plan, still).measure()
    waited = [stop.window_start - stop.in_position_time for stop in live.stops]
    assert max(waited) >= 200 * MS
    # They vibrate in the same windows, so that the drift alone is left.
    assert np.array_equal(stops_of(run).time, stops_of(without).time)
    assert readings(run) - readings(without) == pytest.approx(at_once(run, cell), abs=0.1 * NM)


def test_between_stops_a_change_comes_with_the_way():
    size = 8e-6
    cells = [
        LiveCell(PLAN, with_effects(active("settling", {"axis": "X"}, short_by=short)))
        for short in (size, 0.0)
    ]
    for cell in cells:
        cell.measure()
    times = np.array([reading.time for reading in cells[0].readings])
    one, other = (
        np.array([reading.raw_displacement for reading in cell.readings]) for cell in cells
    )
    # Wavelengths in air; the zero of the second setup is set short of a stop of the first.
    added = (one - other) / 1.00027
    assert np.nanmax(np.abs(added)) < (1.0 + 0.6) * size
    assert np.all(added[(times < cells[0].start) & np.isfinite(added)] == 0.0)
    stop = next(
        stop
        for stop in cells[0].stops
        if str(stop.line) == "x forward, repeat 0" and stop.command.stop == 1
    )
    moving = (times >= stop.command.time) & (times <= stop.in_position_time)
    way = added[moving]
    assert way[0] == pytest.approx(0.0, abs=1 * NM)
    assert way[-1] == pytest.approx(-size, abs=1 * NM)
    assert np.all(np.diff(way) < 0.01 * NM)
    # One reading's share is that of its way, 10 ms at 50 mm/s, in one of 10.3 mm.
    assert np.max(-np.diff(way)) == pytest.approx(size * 0.5 / 10.3, rel=0.1)
    stands = (times >= stop.in_position_time) & (times < stop.window_end)
    assert added[stands] == pytest.approx(np.full(np.count_nonzero(stands), -size), abs=1 * NM)


def broken(cell):
    """Break the beam in the second pass of the first diagonal; the sequence measures it again."""

    def look(stop):
        here = stop.command.attempt == 1 and stop.command.stop == 4
        if here and str(stop.line) == "npp YZX backward, repeat 0":
            cell.laser.inject_beam_break(cell.now + 400 * MS, cell.now + 500 * MS)

    cell.watchers.append(look)
    return cell


def test_a_setup_that_is_aligned_again_begins_anew():
    slip = {**SLIP, "direction": "forward"}
    cell = with_effects(
        active("backlash", {"axis": "Y"}, lost_motion=2e-6),
        active("fringe slip", slip, size=0.6e-6),
        active("drift", {"along": "Z"}, m_per_s=2e-8),
    )
    live = broken(LiveCell(PLAN, cell))
    run = live.measure()
    assert {line.setup for line in run.lines} == {"x", "npp YZX", "npp YZX #2"}
    expected = at_once(run, cell)
    found = readings(run) - readings(bare_and_broken())
    assert found == pytest.approx(expected, abs=0.1 * NM)
    # The slip of the first pass is gone with its zero; so is the way that the axes had come.
    anew = [line for line in run.lines if line.setup.endswith("#2")]
    assert len(anew) == 3 and anew[0].attempt == 2


def test_an_effect_of_a_setup_stays_when_the_setup_is_aligned_again():
    cell = with_effects(active("cosine error", {"setup": "npp YZX"}, scale=20e-6))
    run = broken(LiveCell(PLAN, cell)).measure()
    found = readings(run) - readings(bare_and_broken())
    stops = stops_of(run)
    here = [name.startswith("npp YZX") for name in stops.setups]
    scaled = np.where(np.array(here)[stops.setup], 20e-6 * stops.along, 0.0)
    for setup in range(len(stops.setups)):
        rows = stops.setup == setup
        scaled[rows] -= scaled[rows][0]
    assert found == pytest.approx(scaled, abs=0.1 * NM)
    assert np.ptp(found[stops.setup == stops.setups.index("npp YZX #2")]) > 0.5e-6


def test_an_effect_that_cannot_act_is_refused_before_the_run():
    cell = with_effects(active("fringe slip", {**SLIP, "repeat": 7}, size=1e-6))
    device = prepare("interferometer", "simulated", {}, Surroundings(cell=cell))(START)
    assert isinstance(device, FollowsRun)
    with refused(Refusal, "not_found", "npp", "YZX", "7"):
        device.begin_run(PLAN, START)


def test_a_plan_beyond_the_cells_errors_is_refused_before_the_run():
    device = prepare("interferometer", "simulated", {}, Surroundings(cell=CELL))(START)
    assert isinstance(device, FollowsRun)
    larger = replace(PLAN, volume=replace(PLAN.volume, blocks=90))
    with refused(Refusal, "out_of_range"):
        device.begin_run(larger, START)


def test_a_long_run_is_followed_in_no_time():
    plan = replace(PLAN, volume=replace(PLAN.volume, blocks=90, step=(1e-3, 1e-3, 1e-3)))
    assert plan.stop_count > 1400
    cell = with_effects(active("angular error", {"error": "E_CZ"}, linear=1e-5, quadratic=0.0))
    effects = LiveEffects(plan, cell)
    here = CELL.environment(0.0)
    begin = process_time()
    values = [effects.at(7, number, "npp YZX", 100.0 + number, here) for number in range(100)]
    # The costliest of all effects, about 0.4 ms; much is allowed for a slow computer.
    assert (process_time() - begin) / 100 < 5e-3
    assert len(set(values)) > 30
