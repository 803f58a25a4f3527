"""What planning by information per second is worth, on worst plausible machines.

Prints one JSON document: processor time of a plan, machine seconds to the uncertainty of the demo
plan, expected against measured uncertainty and coverage on planned runs, what drift does in the
planned and in the usual order, and what ``--until`` saves in both.

    python benchmarks/planning.py --machines 100
"""

import argparse
import json
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
sys.path[:0] = [str(Path(__file__).parents[1] / "test" / "bands")]

import numpy as np  # noqa: E402
from plausible_machines import ANGLE, NOISE, draw  # noqa: E402
from shared import lead_of_all  # noqa: E402

from stepdiag_ros.configuration import load_machine, load_plan  # noqa: E402
from stepdiag_ros.evaluation.pursuit import Pursuit, reached  # noqa: E402
from stepdiag_ros.metrology.geometry import SQUARENESS, TRANSLATIONS, beam_direction  # noqa: E402
from stepdiag_ros.metrology.machine import Machine  # noqa: E402
from stepdiag_ros.metrology.on_the_fly.expected import Streams  # noqa: E402
from stepdiag_ros.metrology.plausible import Plausible  # noqa: E402
from stepdiag_ros.metrology.solvers import solve  # noqa: E402
from stepdiag_ros.metrology.target import VOLUMETRIC, Target  # noqa: E402
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR  # noqa: E402
from stepdiag_ros.metrology.volumetric_map import VolumetricMap, places_of  # noqa: E402
from stepdiag_ros.planning.candidates import PURPOSES  # noqa: E402
from stepdiag_ros.planning.duration import Assumptions, duration  # noqa: E402
from stepdiag_ros.planning.expectation import nominal_measurement  # noqa: E402
from stepdiag_ros.planning.information import Information  # noqa: E402
from stepdiag_ros.planning.offers import StopNoise, offers_of  # noqa: E402
from stepdiag_ros.planning.proposal import propose  # noqa: E402
from stepdiag_ros.planning.request import Request, sampling_with  # noqa: E402

NO_ALIGNMENT = Assumptions(linear_alignment_s=0.0, diagonal_alignment_s=0.0)
CUBE = {"low": (0.0, 0.0, 0.0), "high": (0.12, 0.12, 0.12), "blocks": 12}
NAMES = (*TRANSLATIONS, *SQUARENESS, VOLUMETRIC)
PLACE, READING = 0.01e-6, 0.01e-6
"""m, m √s: of the demo cell's stops, whose readings scatter by 0.1 µm at 100 Hz."""
STREAMS = Streams(reading_noise=0.1e-6 / np.sqrt(1000.0))
"""Of the moving cell, whose readings scatter by as much at 1 kHz."""


def expected(plan, machine, noise):
    """Return the standard uncertainties that are expected of a plan, by quantity."""
    lines = {replace(line, repeat=0, direction="forward") for line in plan.lines}
    offers = offers_of(
        lines, plan, machine, noise.of(plan.sampling.window), ("forward",), NO_ALIGNMENT
    )
    information = Information(
        offers, plan.volume, machine.chain, Plausible(machine.rotations), NAMES
    )
    done = [replace(line, repeat=0, direction="forward") for line in plan.lines]
    counts = np.array([done.count(offer.line) for offer in offers])
    return information.standing(counts).largest()


def speed():
    """Return what a plan for 12 blocks and four diagonals takes of the processor, s."""
    begin = time.process_time()
    sum(i * i for i in range(1_000_000))
    step = time.process_time() - begin
    times = {}
    for name, wish in (
        ("until", {"until": {VOLUMETRIC: 4e-6}}),
        ("time", {"time_limit": 7800.0}),
    ):
        begin = time.process_time()
        propose(Request("volumetric", load_machine("demo")[0], **CUBE, **wish))
        times[name] = round(time.process_time() - begin, 1)
    return {"processor_s": times, "a_million_steps_ms": round(1e3 * step)}


def seconds_to_the_demo(rotations, streams=None):
    """Return machine seconds to the demo plan's U of nine curves and squareness."""
    demo, machine = load_plan("demo")[0], replace(load_machine("demo")[0], rotations=rotations)
    noise = StopNoise(PLACE, READING)
    told = expected(demo, machine, noise)
    until = {name: COVERAGE_FACTOR * told[name] for name in (*TRANSLATIONS, *SQUARENESS)}
    chosen = propose(
        Request(
            "volumetric",
            machine,
            stop_uncertainty=PLACE,
            reading_noise=READING,
            until=until,
            assumptions=NO_ALIGNMENT,
            streams=streams,
            **CUBE,
        )
    ).chosen
    before = duration(demo, machine).total
    return {
        "U_of_E_XX_um": round(1e6 * until["E_XX"], 4),
        "U_of_C0Y_um_per_m": round(1e6 * until["C0Y"], 3),
        "demo_s": round(before),
        "planned_s": round(chosen.duration.total),
        "ratio": round(chosen.duration.total / before, 3),
        "lines": chosen.words,
        "measurement": chosen.plan.measurement,
        "dwell_s": chosen.plan.sampling.dwell,
        "feed_m_per_s": chosen.plan.feed,
    }


def described(drawn):
    """Return a drawn machine as its user describes it."""
    low = tuple(start - 0.01 for start in drawn.origin)
    high = tuple(start + way + 0.01 for start, way in zip(drawn.origin, drawn.travel, strict=True))
    return Machine(drawn.cell.name, drawn.chain, low, high, 0.5, 2.0, rotations=ANGLE)


def planned(drawn, **wishes):
    """Return the plan for a drawn machine over its whole box."""
    rng = np.random.default_rng([drawn.seed, 11])
    high = tuple(a + b for a, b in zip(drawn.origin, drawn.travel, strict=True))
    request = Request(
        "volumetric",
        described(drawn),
        stop_uncertainty=NOISE,
        sampling=sampling_with(1.0),
        low=drawn.origin,
        high=high,
        blocks=int(rng.integers(5, 11)),
        **wishes,
    )
    return propose(request).chosen.plan


def run_of(seed):
    """Return of one machine and its plan: measured over expected U, and which bands hold."""
    drawn = draw(seed)
    plan = planned(drawn)
    told = expected(plan, described(drawn), StopNoise(NOISE))
    measurement = drawn.measure(plan)
    result, truth = solve(measurement), drawn.truth(plan.volume)
    error_map = VolumetricMap.of_result(result, drawn.chain, measurement.plausible)
    corners = places_of([nodes[[0, -1]] for nodes in result.nodes])
    measured = {name: np.max(result.standard_uncertainty[name]) for name in TRANSLATIONS}
    measured |= {name: result.figure(name).standard_uncertainty for name in SQUARENESS}
    measured[VOLUMETRIC] = np.sqrt(
        np.max(np.diagonal(error_map.covariance_at(corners), axis1=1, axis2=2))
    )
    inside = []
    for name in TRANSLATIONS:
        spread = result.standard_uncertainty[name]
        known = spread > 0.0
        missed = np.abs(result.curves[name] - truth.curves[name])[known]
        inside += list(missed <= COVERAGE_FACTOR * spread[known])
    for name in SQUARENESS:
        figure = result.figure(name)
        missed = abs(figure.value - truth.figures[name])
        inside.append(missed <= COVERAGE_FACTOR * figure.standard_uncertainty)
    run = reached_by(measurement, result)
    return (
        {name: float(measured[name] / told[name]) for name in NAMES},
        float(run / (COVERAGE_FACTOR * told[VOLUMETRIC])),
        [bool(one) for one in inside],
        drawn.noise_told,
    )


def reached_by(measurement, result):
    """Return the expanded uncertainty of the largest error that a run states, m."""
    results = {"least_squares": result}
    lead = lead_of_all(results, measurement)
    return reached(Target(VOLUMETRIC, 1.0, "m"), measurement, results, lead)


def as_usual(plan):
    """Return the lines of a plan in the order of a plan by hand: one after the other."""
    keys = list(
        dict.fromkeys((line.kind, line.name, line.order, line.offset) for line in plan.lines)
    )
    keys.sort(key=lambda key: key[0] != "linear")
    lines = sorted(
        plan.lines,
        key=lambda line: keys.index((line.kind, line.name, line.order, line.offset)),
    )
    return replace(plan, lines=tuple(lines))


def _key(line):
    return line.kind, line.name, line.order, line.offset


def by_growth(plan, machine):
    """Return what axes that grow at the machine's rate do to squareness, rad, and curves, m."""
    lines, now, middle = [], 0.0, []
    for line, taken in zip(
        nominal_measurement(plan, NOISE).lines, duration(plan, machine).lines, strict=True
    ):
        now += taken.alignment + taken.positioning
        stamps = now + np.linspace(0.0, taken.moves + taken.dwells, len(line.time))
        now += taken.moves + taken.dwells
        lines.append((line, stamps))
        middle.append(np.mean(stamps))
    grown = []
    for line, stamps in lines:
        ways = (line.target - plan.volume.origin) * beam_direction(
            line.line.name, np.asarray(plan.volume.step)
        )
        more = machine.growth_per_s * (stamps - np.mean(middle)) * np.sum(ways, axis=1)
        grown.append(replace(line, displacement=line.displacement + more))
    measurement = replace(nominal_measurement(plan, NOISE), lines=tuple(grown))
    result = solve(replace(measurement, chain=machine.chain, plausible=Plausible(ANGLE)))
    return (
        max(abs(result.figure(name).value) for name in SQUARENESS),
        max(float(np.max(np.abs(result.curves[name]))) for name in TRANSLATIONS),
    )


def orders_of(seed):
    """Return of one machine: effect of growth and time to a target, planned and usual order."""
    drawn = draw(seed)
    machine = described(drawn)
    plan = planned(drawn, repeats=4, assumptions=NO_ALIGNMENT)
    both = {"planned": plan, "usual": as_usual(plan)}
    target = Target(VOLUMETRIC, 1.0, "m")
    found = {name: {"growth": by_growth(one, machine)} for name, one in both.items()}
    other = drawn.measure(plan, day=1)
    asked = 1.1 * reached_by(other, solve(other))
    for name, one in both.items():
        measurement, pursuit = drawn.measure(one), Pursuit(target, one, machine)
        taken = None
        for end in pursuit.line_ends:
            first = replace(measurement, lines=measurement.lines[:end])
            if reached_by(first, solve(first)) <= asked:
                taken = sum(pursuit.line_times[:end]) / sum(pursuit.line_times)
                break
        found[name]["share"] = taken
    return found


def spread_of(values):
    """Return median and the interval of the middle nine tenths; None without values."""
    if not values:
        return None
    low, middle, high = np.percentile(values, [5, 50, 95])
    return {"median": round(middle, 3), "5 %": round(low, 3), "95 %": round(high, 3)}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--machines", type=int, default=100)
    parser.add_argument("--orders", type=int, default=20, help="machines for the order of lines")
    parser.add_argument("--processes", type=int, default=2)
    arguments = parser.parse_args()
    document = {
        "plan": speed(),
        "seconds_to_the_demo_plans_U": {
            "readings alone": seconds_to_the_demo(0.0),
            "with plausible rotations": seconds_to_the_demo(10e-6),
            "readings alone, on the fly": seconds_to_the_demo(0.0, STREAMS),
            "with plausible rotations, on the fly": seconds_to_the_demo(10e-6, STREAMS),
        },
    }
    with ProcessPoolExecutor(arguments.processes) as pool:
        runs = list(pool.map(run_of, range(arguments.machines)))
        orders = list(pool.map(orders_of, range(arguments.orders)))
    known = [ratios for ratios, _, _, told in runs if told]
    within = [abs(ratio - 1.0) <= 0.1 for ratios in known for ratio in ratios.values()]
    inside = np.concatenate([one for _, _, one, _ in runs])
    ended = [one for one in orders if None not in (one["planned"]["share"], one["usual"]["share"])]
    document |= {
        "machines": arguments.machines,
        "purpose": PURPOSES["volumetric"].words,
        "measured_over_expected_U": {
            name: spread_of([ratios[name] for ratios in known]) for name in NAMES
        },
        "all_quantities_within_10_percent": round(float(np.mean(within)), 3) if within else None,
        "U_of_the_largest_error_over_expected": spread_of([one for _, one, _, _ in runs]),
        "coverage": round(float(np.mean(inside)), 4),
        "growth": {
            name: {
                "squareness_um_per_m": spread_of([1e6 * one[name]["growth"][0] for one in orders]),
                "curves_um": spread_of([1e6 * one[name]["growth"][1] for one in orders]),
            }
            for name in ("planned", "usual")
        },
        "share_of_the_plan_until_the_target": {
            name: spread_of([one[name]["share"] for one in ended]) for name in ("planned", "usual")
        },
        "runs_that_reach_the_target_in_both_orders": len(ended),
    }
    print(json.dumps(document, indent=2))


if __name__ == "__main__":
    main()
