"""Clock offset and transport delay from the moves: on exact motion, and on simulated devices."""

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cells_for_tests import make_cell

from stepdiag_ros.devices import Surroundings, prepare
from stepdiag_ros.devices.cnc import CncState, PositionSample
from stepdiag_ros.metrology.cell import DriveModel
from stepdiag_ros.metrology.geometry import beam_direction
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.time_alignment import (
    SEARCH_LIMIT,
    LineRecord,
    TimeOffset,
    line_offset,
    run_timing,
)

START = 1_700_000_000_000_000_000
MS = 1_000_000
STEP = (0.01, 0.012, 0.008)
MACHINE = Machine("m", "YXZ", (-0.1, -0.1, -0.1), (0.5, 0.4, 0.3), 0.5, 2.0)


def crooked_cell(random):
    """A machine with errors of its own, its mirrors as crooked as they may be."""
    cell = make_cell(
        seed=int(random.integers(1000)),
        high=(0.2,) * 3,
        positioning=5e-6,
        size=2e-6,
        rotation=1e-5,
        squareness=(0.0,) * 3,
        tilt=2e-4,
        mirror=2e-4,
        dead_path_m=0.4,
        held=0.0,
    )
    return replace(cell, drive=DriveModel(lag_s=float(random.uniform(0.002, 0.02))))


def measured_line(name, random, **options):
    """One line of a step diagonal or an axis on the simulated controller and interferometer."""
    position_rate = float(random.choice((50.0, 120.0)))
    rate = float(random.choice((137.0, 400.0, 1000.0)))
    around = Surroundings(MACHINE, crooked_cell(random))
    cnc = prepare("cnc", "simulated", {"position_rate_hz": position_rate}, around)(START)
    settings = {"rate_hz": rate, "hold_after_s": 3600.0, "seed": int(random.integers(2**31))}
    laser = prepare("interferometer", "simulated", {**settings, **options}, around)(START)
    laser.align(START, name, name, STEP, (0.0, 0.0, 0.0))
    feed, now = float(random.uniform(0.02, 0.08)), START
    axes = [name.upper()] * 6 if len(name) == 1 else list("XYZ") * 3
    target, moves, wait = [0.0, 0.0, 0.0], iter(axes), START + 1500 * MS
    times, places = [], []
    left = 2.0
    while left > 0.0:
        now += 100 * MS
        for event in cnc.poll(now):
            if isinstance(event, PositionSample):
                laser.update_position(event.time, event.position)
                times.append(event.time)
                places.append(event.position)
            elif event.state is CncState.READY:
                wait = event.time + round(random.uniform(0.3, 0.5) * 1e9)
        if cnc.state is CncState.READY and now >= wait:
            axis = next(moves, None)
            if axis is None:
                left -= 0.1
            else:
                target["XYZ".index(axis)] += STEP["XYZ".index(axis)]
                cnc.start_move(now, tuple(target), feed, axis)
    blocks = laser.poll_samples(now)
    along = np.array(places) @ beam_direction(name, np.asarray(STEP))
    return LineRecord(
        np.array(times),
        along,
        np.array([block.time_of(n) for block in blocks for n in range(block.sequence, block.end)]),
        np.concatenate([block.raw_displacement for block in blocks]),
    )


def moved(count=8, feed=0.05, dwell=0.6, length=0.01, positions=50.0, phase=0.0, lag=0.01):
    """Exact motion with ramps of 0.2 m/s² and a lag, and the times of its positions, s."""

    def place(time):
        fine = np.arange(-1.0, 1.5 * dwell + 2.0 + count * (length / feed + 0.25 + dwell), 5e-4)
        speed = np.zeros(len(fine))
        ramp, begin = feed / 0.2, 1.5
        for _ in range(count):
            run = length / feed
            speed += feed * np.clip(
                np.minimum((fine - begin) / ramp, (begin + run + ramp - fine) / ramp), 0.0, 1.0
            )
            begin += run + ramp + dwell
        kernel = np.exp(-np.arange(0.0, 10 * lag, 5e-4) / lag)
        slow = np.convolve(speed, kernel / kernel.sum())[: len(speed)]
        way = np.concatenate(([0.0], np.cumsum(0.5 * (slow[1:] + slow[:-1])) * 5e-4))
        return np.interp(time, fine, way)

    end = 1.5 + count * (length / feed + feed / 0.2 + dwell) + 1.0
    return np.arange(phase / positions, end, 1.0 / positions), place


def recorded(late, seed=0, slope=0.9997, noise=1e-7, rate=1000.0, **motion):
    times, place = moved(**motion)
    readings = np.arange(times[0], times[-1], 1.0 / rate)
    values = 0.02 + slope * place(readings)
    values = values + noise * np.random.default_rng(seed).standard_normal(len(values))
    return LineRecord(
        START + np.rint(times * 1e9).astype(np.int64),
        place(times),
        START + np.rint((readings + late) * 1e9).astype(np.int64),
        values,
    )


@cache
def random_runs(count):
    """True and found offset of lines with random machines, rates, clocks and delays."""
    random = np.random.default_rng(17)
    told = []
    for _ in range(count):
        delay = float(random.uniform(0.0, 0.05))
        offset = float(random.choice((1e-4, 1e-2, 0.3)) * random.uniform(-1.0, 1.0))
        name = str(random.choice(("x", "y", "z", "ppp")))
        record = measured_line(name, random, transport_delay_s=delay, clock_offset_s=offset)
        told.append((delay + offset, line_offset(record)))
    return told


@pytest.mark.parametrize(("count", "most_outside"), [(10, 3), (100, 12)], ids=["few", "many"])
def test_random_runs_are_found_within_their_uncertainty(count, most_outside):
    told = random_runs(count)
    assert all(found.reason == "" and found.others == () for _, found in told)
    errors = np.array([found.offset - true for true, found in told])
    expanded = np.array([found.expanded_uncertainty for _, found in told])
    outside = int(np.sum(np.abs(errors) > expanded))
    # 95 % intervals: 5 of 100 lie outside. More than 12 of 100, or 3 of 10, come once in a
    # thousand times.
    assert outside <= most_outside
    ratio = errors / np.array([found.standard_uncertainty for _, found in told])
    # The median of |t| is 0.73 with 5 degrees of freedom, and less for what the uncertainty of
    # positions between their samples adds, which a simulated machine has not.
    assert np.median(np.abs(ratio)) < 0.9
    assert abs(np.median(ratio)) < 0.35
    # Far below a sample of either stream: those are 1 to 20 ms.
    assert np.abs(errors).max() < 1e-5
    assert np.median(np.abs(errors)) < 1e-6
    # ... and the uncertainty says so: most of it is for what positions do between their samples.
    assert np.median(expanded) < 2e-5


@pytest.mark.parametrize("late", [-0.4, -0.0137, 0.0, 2.5e-6, 0.0123, 0.7])
def test_exact_motion_with_slow_positions_is_found_far_below_a_sample(late):
    found = line_offset(recorded(late, phase=0.3))
    assert found.moves == 8
    assert found.offset == pytest.approx(late, abs=1e-4)
    assert abs(found.offset - late) <= found.expanded_uncertainty


def test_moves_in_step_with_slow_positions_do_not_feign_certainty():
    found = line_offset(recorded(0.0123, count=60))
    # Every other move meets the same phase of the positions: no scatter, but 10 µs of error.
    assert abs(found.offset - 0.0123) <= found.expanded_uncertainty < 1e-4


@pytest.mark.parametrize(("positions", "readings"), [(50.0, 100.0), (50.0, 2000.0), (1000.0, 50.0)])
def test_positions_may_be_faster_or_slower_than_readings(positions, readings):
    motion = {"positions": positions, "rate": readings, "lag": 0.02}
    errors = [
        line_offset(recorded(0.0171, seed, phase=seed / 7, **motion)).offset - 0.0171
        for seed in range(7)
    ]
    assert np.abs(errors).max() < 3e-4
    assert abs(np.mean(errors)) < 1e-4


def test_what_cannot_be_said_is_not_said():
    whole = recorded(0.01)
    still = replace(whole, positions=np.zeros(len(whole.positions)))
    assert "0 moves" in line_offset(still).reason
    assert np.isnan(line_offset(still).offset)
    assert "moves" in line_offset(recorded(0.01, count=2)).reason
    far = line_offset(recorded(3.0, count=5))
    assert "do not fit within 1 s" in far.reason or far.others
    few = replace(
        whole, reading_times=whole.reading_times[:5], displacements=whole.displacements[:5]
    )
    assert "good readings" in line_offset(few).reason
    none = replace(whole, position_times=whole.position_times[:3], positions=whole.positions[:3])
    assert "positions" in line_offset(none).reason
    assert np.isnan(TimeOffset().expanded_uncertainty)
    assert run_timing([]).offset.reason == "no line was measured"
    assert "moves" in run_timing([line_offset(still)]).offset.reason


def test_another_offset_that_fits_as_well_is_told():
    """Steps all alike, and readings of the middle of the line alone: one step earlier fits too."""
    whole = recorded(0.0, count=12, dwell=0.25, length=0.01, feed=0.1)
    inside = (whole.reading_times > START + int(4.0e9)) & (whole.reading_times < START + int(6.0e9))
    part = replace(
        whole,
        reading_times=whole.reading_times[inside],
        displacements=whole.displacements[inside],
    )
    found = line_offset(part)
    period = 0.01 / 0.1 + 0.1 / 0.2 + 0.25
    assert period < SEARCH_LIMIT
    assert {round(abs(other - found.offset) / period, 1) for other in found.others} == {1.0}


def test_a_clock_that_drifts_is_told_from_one_that_does_not():
    random = np.random.default_rng(3)
    lines = [
        TimeOffset(START + int(t * 1e9), 0.005 + 2e-6 * (t - 1800.0) + 1e-6 * e, 1e-6, 12, 13)
        for t, e in zip(np.linspace(0.0, 3600.0, 9), random.standard_normal(9), strict=True)
    ]
    timing = run_timing(lines)
    assert timing.drift == pytest.approx(2e-6, abs=3 * timing.drift_uncertainty)
    assert timing.drift_uncertainty < 1e-9
    assert timing.offset.offset == pytest.approx(0.005, abs=2e-6)
    assert timing.offset.moves == 117
    pair = run_timing(lines[:2])
    assert np.isnan(pair.drift) and np.isfinite(pair.offset.standard_uncertainty)


def test_offsets_of_lines_that_scatter_widen_the_uncertainty():
    lines = [
        TimeOffset(START + int(t * 1e9), value, 1e-6, 12, 13)
        for t, value in zip(itertools.count(0, 60), (0.0, 1e-3, 0.0, 1e-3), strict=False)
    ]
    assert run_timing(lines).offset.standard_uncertainty > 2e-4
