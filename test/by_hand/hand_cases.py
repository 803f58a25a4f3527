"""Random recordings of NC programs, with what went wrong in them, and what is true of every moment.

A case is made from two whole numbers: which fault, and the seed of everything else (plan, machine,
noise, rate, dwell, where the fault is).
"""

from bisect import bisect_right
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from cells_for_tests import make_cell
from program_run import Instrument, run_program

from stepdiag_ros.metrology.assembly import assemble
from stepdiag_ros.metrology.by_hand import (
    Numbering,
    as_commanded,
    find_stops,
    objection_to,
    plan_by_hand,
)
from stepdiag_ros.metrology.measurement import MeasuredLine, SettledStop
from stepdiag_ros.metrology.plan import Plan
from stepdiag_ros.planning.moves import dwell_of, moves_of, passes_of

FAULTS = (
    "none",
    "cut at the beginning",
    "cut at the end",
    "hole",
    "missed stop",
    "two missed stops",
    "doubled stop",
    "extra stop",
    "feed hold",
    "beam break",
    "silent loss of zero",
    "wrong direction",
    "wrong plan",
    "line left out",
    "line run twice",
    "spikes",
    "feed override",
    "reversed sign",
    "another program",
)
HARMLESS = ("none", "spikes", "feed override")
"""Faults in spite of which every line must be found."""


@dataclass(frozen=True)
class Truth:
    """What stood at a time: line and stop of the plan, or None for a rest that is no stop."""

    begins: tuple[int, ...]
    stops: tuple[tuple[int, int] | None, ...]
    places: tuple[tuple[float, float, float], ...]

    def at(self, time):
        """Return what the machine stood at at a time, ns."""
        number = bisect_right(self.begins, time) - 1
        return self.stops[number], self.places[number]


@dataclass(frozen=True)
class Case:
    fault: str
    plan: Plan
    program: Plan
    readings: tuple
    truth: Truth
    touched: frozenset[int]


def random_plan(rng):
    equal = rng.random() < 0.6
    step = [rng.choice([0.004, 0.01, 0.025])] * 3
    if not equal:
        step = [float(value) for value in rng.uniform(0.004, 0.03, 3).round(4)]
    rate = float(rng.choice([2.0, 5.0, 10.0, 33.3, 100.0]))
    window = max(0.3, 4.0 / rate)
    settle = 0.1 if rate > 5.0 else 0.5
    diagonal_kind = rng.random() < 0.25
    groups = [
        {"kind": "linear", "names": ["x", "y", "z"][: int(rng.integers(1, 4))]},
        {"kind": "step_diagonal", "names": ["ppp", "npp", "pnp"][: int(rng.integers(1, 4))]},
    ]
    if diagonal_kind:
        groups.append({"kind": "diagonal", "names": ["ppp", "pp0"]})
    if rng.random() < 0.5:
        groups.reverse()
    return rate, Plan.from_mapping(
        {
            "name": "random",
            "step_m": [float(value) for value in step],
            "blocks": int(rng.integers(3, 8)),
            "repeats": int(rng.integers(1, 3)),
            "directions": ["forward", "backward"] if rng.random() < 0.6 else ["forward"],
            "feed_m_per_s": float(rng.choice([0.01, 0.033, 0.1])),
            "overrun_m": 0.002 if diagonal_kind else 0.0,
            "lines": groups,
            "sampling": {
                "settle_s": settle,
                "window_s": window,
                "dwell_s": settle + 2.0 * window,
                "longest_wait_s": 20.0,
                "standard_deviation_limit_m": 2e-6,
                "drift_limit_m": 2e-6,
            },
        },
        "random plan",
    )


def random_cell(rng):
    return make_cell(
        seed=int(rng.integers(1, 10**6)),
        high=(0.25,) * 3,
        positioning=float(10 ** rng.uniform(-6, -4.3)),
        size=5e-6,
        squareness=(1e-4, -5e-5, 2e-5),
        tilt=1e-3,
        mirror=1e-4,
        noise=float(10 ** rng.uniform(-8, -6)),
        weather={"air_temperature_drift_K_per_h": float(rng.normal(0.0, 2.0))},
        drive={
            "lag_s": float(rng.choice([0.005, 0.02, 0.05])),
            "settling_amplitude_m": float(rng.choice([0.0, 2e-6, 20e-6])),
            "settling_time_s": 0.03,
        },
        held=0.0,
    )


def another_plan(plan, rng):
    """Return a plan like another in all but blocks, steps, repeats or directions.

    Its stops are elsewhere by more than a machine can be wrong, or there are more or fewer passes.
    """
    volume = plan.volume
    what = rng.choice(["blocks", "steps", "a step", "repeats", "directions", "both"])
    if what in ("blocks", "both"):
        blocks = int(rng.choice([n for n in range(1, 13) if n != volume.blocks]))
        volume = replace(volume, blocks=blocks)
    if what in ("steps", "both"):
        factor = float(rng.choice([0.5, 0.97, 0.98, 1.02, 1.03, 2.0]))
        volume = replace(volume, step=tuple(factor * value for value in volume.step))
    if what == "a step":
        step, axis = list(volume.step), int(rng.integers(3))
        # Seen along a body diagonal, too: the farthest stop is off by half a millimetre.
        seen = 5e-4 * float(np.linalg.norm(step)) / (volume.blocks * step[axis])
        step[axis] += max(0.03 * step[axis], seen)
        volume = replace(volume, step=tuple(step))
    lines = plan.lines
    if what == "repeats":
        once = [line for line in lines if not line.repeat]
        setups = [list(group) for _, group in groupby(once, lambda line: line.setup)]
        twice = [replace(line, repeat=n) for own in setups for n in (0, 1) for line in own]
        lines = twice if len(once) == len(lines) else once
    if what == "directions":
        forward = [line for line in lines if line.direction == "forward"]
        back = [(line, replace(line, direction="backward")) for line in forward]
        lines = [one for both in back for one in both] if len(forward) == len(lines) else forward
    return replace(plan, volume=volume, lines=tuple(lines))


def make_case(fault, seed):
    """Return the case of a fault and a seed."""
    rng = np.random.default_rng([FAULTS.index(fault), seed])
    rate, plan = random_plan(rng)
    cell = random_cell(rng)
    made_with = plan
    if fault == "wrong plan":
        volume = plan.volume
        if rng.random() < 0.5:
            volume = replace(volume, blocks=volume.blocks + int(rng.choice([-1, 1, 2])))
        else:
            volume = replace(volume, step=tuple(1.3 * value for value in volume.step))
        made_with = replace(plan, volume=volume)
    elif fault == "another program":
        made_with = another_plan(plan, rng)
    moves, labels = list(moves_of(made_with)), []
    for index, one in enumerate(passes_of(made_with)):
        before = len(one.targets) - one.stops
        labels += [None] * (before + one.new_setup)
        labels += [(index, stop) for stop in range(one.stops)]
    assert len(labels) == len(moves)
    everything = fault in ("wrong plan", "reversed sign", "another program")
    touched = set(range(len(plan.lines))) if everything else set()
    moves, labels = _changed(fault, moves, labels, touched, plan, rng)
    feed = plan.feed * (0.6 if fault == "feed override" else 1.0)
    seen = run_program(
        made_with,
        moves,
        cell,
        float(rng.choice([0.5, 2.0])),
        Instrument(
            rate=rate,
            quantum=float(rng.choice([0.0, 1e-8, 1e-7])),
            seed=seed,
            work=float(rng.uniform(3.0, 12.0)),
            feed=feed,
        ),
    )
    truth = Truth(seen.arrivals, tuple(labels), seen.places)
    readings = _recorded(fault, seen.readings, truth, touched, rate, rng)
    return Case(fault, plan, made_with, tuple(readings), truth, frozenset(touched))


def _changed(fault, moves, labels, touched, plan, rng):
    """Return the moves and their stops with what goes wrong at the machine."""
    stops = [n for n, label in enumerate(labels) if label is not None and label[1] > 0]
    chosen = int(rng.choice(stops))
    line, _ = labels[chosen]
    if fault in ("missed stop", "two missed stops"):
        both = [n for n in stops if labels[n][0] == line]
        picked = rng.choice(both, size=1 + (fault != "missed stop"), replace=False).tolist()
        for number in picked:
            moves[number] = replace(moves[number], dwell_s=0.0)
        touched.add(line)
    elif fault in ("doubled stop", "extra stop", "feed hold"):
        # A place between the stop before and this one, for a while.
        part = float(rng.uniform(0.1, 0.9))
        a, b = np.array(moves[chosen - 1].target_m), np.array(moves[chosen].target_m)
        between = tuple((a + part * (b - a)).tolist())
        seconds = dwell_of(plan) * float(rng.uniform(1.0, 4.0))
        hold = replace(moves[chosen], target_m=between, dwell_s=seconds, program_stop="")
        if fault == "feed hold":
            added = [hold]
        elif fault == "doubled stop":
            added = [replace(hold, dwell_s=0.0), replace(moves[chosen - 1], program_stop="")]
        else:
            off = float(rng.uniform(-1.5, 1.5))
            place = tuple((a + off * (b - a)).tolist())
            added = [replace(hold, target_m=place)]
        moves[chosen:chosen] = added
        labels[chosen:chosen] = [
            labels[chosen - 1] if move.dwell_s and fault == "doubled stop" else None
            for move in added
        ]
        touched.add(line)
    elif fault == "wrong direction":
        own = [n for n, label in enumerate(labels) if label is not None and label[0] == line]
        places = [moves[n].target_m for n in own][::-1]
        for number, place in zip(own, places, strict=True):
            moves[number] = replace(moves[number], target_m=place)
            labels[number] = None
        touched.add(line)
    elif fault in ("line left out", "line run twice"):
        own = [n for n, label in enumerate(labels) if label is not None and label[0] == line]
        # What leads to the line and aligns for it is done in any case.
        first, last = own[0], own[-1] + 1
        if fault == "line left out":
            if moves[first].program_stop:
                moves[first], labels[first] = replace(moves[first], dwell_s=0.0), None
                first += 1
            del moves[first:last], labels[first:last]
        else:
            moves[last:last] = [replace(move, program_stop="") for move in moves[first:last]]
            labels[last:last] = labels[first:last]
        touched.add(line)
    return moves, labels


def _recorded(fault, readings, truth, touched, rate, rng):
    """Return the readings with what goes wrong at the instrument."""
    stops = [n for n, label in enumerate(truth.stops) if label is not None]
    chosen = int(rng.choice(stops[1:]))
    time = truth.begins[chosen] - round(float(rng.uniform(0.0, 1.0)) * 1e9)
    line = truth.stops[chosen][0]

    def lines_of(numbers):
        return {truth.stops[n][0] for n in numbers if truth.stops[n] is not None}

    if fault == "cut at the beginning":
        touched |= lines_of(n for n in range(chosen))
        return [reading for reading in readings if reading.time >= time]
    if fault == "cut at the end":
        touched |= lines_of(range(chosen, len(truth.stops)))
        return [reading for reading in readings if reading.time < time]
    if fault == "hole":
        until = truth.begins[min(chosen + int(rng.integers(1, 9)), len(truth.begins) - 1)]
        touched |= lines_of(
            n for n, begin in enumerate(truth.begins) if time - 3e9 <= begin <= until
        )
        return [reading for reading in readings if not time <= reading.time < until]
    if fault in ("beam break", "silent loss of zero"):
        jump = float(rng.uniform(-0.05, 0.05))
        touched.add(line)
        if chosen + 1 < len(truth.stops) and truth.stops[chosen + 1] is not None:
            touched.add(truth.stops[chosen + 1][0])
        lasting = round(3.0 / rate * 1e9) if fault == "beam break" else 0
        return [
            reading
            if reading.time < time
            else reading._replace(
                compensated_displacement=reading.compensated_displacement + jump,
                status=2 if reading.time < time + lasting else 0,
            )
            for reading in readings
        ]
    if fault == "spikes":
        hit = rng.random(len(readings)) < 0.002
        return [
            reading._replace(compensated_displacement=reading.compensated_displacement + 5e-3)
            if bad
            else reading
            for reading, bad in zip(readings, hit.tolist(), strict=True)
        ]
    if fault == "reversed sign":
        return [
            reading._replace(compensated_displacement=-reading.compensated_displacement)
            for reading in readings
        ]
    return readings


@dataclass(frozen=True)
class Outcome:
    """What became of a case.

    Attributes:
        shifted: lines and stops that were taken although the machine stood elsewhere.
        taken: lines that were taken.
        refused: lines that were not.
        unsaid: lines that the fault touched, were taken whole, and of which nothing was said.
        settled: stops with a value.
        rejected: stops without one.
    """

    shifted: tuple[str, ...]
    taken: tuple[int, ...]
    refused: tuple[int, ...]
    unsaid: tuple[int, ...]
    settled: int
    rejected: int
    words: tuple[str, ...]


def _same(case, label, taken):
    """Say whether a stop of the program is one of the plan."""
    one, other = case.program.lines[label[0]], case.plan.lines[taken[0]]
    if case.program is not case.plan:
        # Another plan may count its repeats in another way.
        one = replace(one, repeat=other.repeat)
    # Where a line ends, the next begins, the machine stands at a stop of both.
    turns = [
        stop in (0, len(line.stops(plan.volume)) - 1)
        for plan, line, stop in (
            (case.program, one, label[1]),
            (case.plan, other, taken[1]),
        )
    ]
    return one == other or (one.setup == other.setup and all(turns))


def judge(case):
    """Evaluate a case as the command does, and hold what was taken against the truth."""
    plan = case.plan
    objection = objection_to(plan, case.readings)
    if objection:
        return Outcome((), (), tuple(range(len(plan.lines))), (), 0, 0, (objection,))
    found = find_stops(plan, range(len(plan.lines)), case.readings)
    hand = plan_by_hand(plan)
    commands, arrivals = as_commanded(hand, found, 0, Numbering())
    events = assemble(hand, case.readings[0].time, commands, arrivals, case.readings)
    stops = [event for event in events if isinstance(event, SettledStop)]
    lines = {event.line_index: event for event in events if isinstance(event, MeasuredLine)}
    shifted = []
    for stop in stops:
        if not stop.settled:
            continue
        line, number = stop.command.line_index, stop.command.stop
        label, place = case.truth.at(stop.window_start)
        elsewhere = np.max(np.abs(np.subtract(place, stop.command.target))) > 1e-9
        if elsewhere or label is None or not _same(case, label, (line, number)):
            shifted.append(f"{plan.lines[line]} stop {number} is {label}")
    refused = tuple(line.line_index for line in found.lines if line.refusal)
    said = {line.line_index for line in found.lines if line.remarks or line.refusal}
    unsaid = tuple(
        index
        for index in sorted(case.touched)
        if index in lines and lines[index].complete and index not in said
    )
    words = tuple(
        f"{plan.lines[line.line_index]}: {'; '.join((line.refusal, *line.remarks))}"
        for line in found.lines
        if line.refusal or line.remarks
    )
    return Outcome(
        tuple(shifted),
        tuple(lines),
        refused,
        unsaid,
        sum(stop.settled for stop in stops),
        sum(not stop.settled for stop in stops),
        (*words, found.hint) if found.hint else words,
    )
