"""How well histories are read: changes found, false alarms, and crossing intervals that hold.

The generator below imports nothing of the package. It writes what a catalogue would hold of forty
machines that fifty runs each follow for five years: wear, seasons, crashes, repairs, and three
instruments with errors of their own. Histories are read as ``stepdiag history`` would read them
after every run::

    python benchmarks/history.py --seeds 11 12 13
"""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone

import numpy as np

MACHINES, RUNS, YEARS = 40, 50, 5.0
BEGIN = datetime(2021, 1, 1, tzinfo=timezone.utc)
FIGURES = {
    "positioning E_XX": 1.0,
    "positioning E_YY": 0.6,
    "diagonal ppp": 1.3,
    "straightness E_YX": 0.0,
    "straightness E_ZY": 0.0,
    "largest in volume": 1.3,
}
"""Name → length that an error of scale acts on, m."""
REPAIRED_FROM = 12e-6
"""A machine is repaired when a figure is as far off, m."""
TOLERANCE = 25e-6
SCALE = 1e-6
"""Standard uncertainty of the scale of an instrument, as its certificate states it."""
TRAVELS = {"E_XX": 1.0, "E_YY": 0.6, "E_ZZ": (1.3**2 - 1.0**2 - 0.6**2) ** 0.5}


@dataclass
class Machine:
    """One simulated machine: its rows, and what the simulation knows."""

    rows: list[dict]
    events: list[int]  # first run after each crash or repair
    jumps: dict[int, dict[str, float]]  # event → figure → jump over the run-to-run deviation
    level: dict[str, list[float]]  # figure → level at each run, without season
    slope: dict[str, list[float]]  # figure → wear a year at each run
    thermal: dict[str, float]  # figure → change per kelvin from 21 °C


def machine(number: int, random: np.random.Generator, scales: np.ndarray, harsh: bool) -> Machine:
    """Simulate a machine over five years."""
    years = np.sort(random.uniform(0.0, YEARS, RUNS))
    if harsh:  # a quarter of the runs close together, and a gap of some months
        years[:12] = np.sort(years[0] + random.uniform(0.0, 0.3, 12))
        years = np.sort(years)
    phase, swing = random.uniform(-0.1, 0.1), random.uniform(1.0, 6.0)
    wave = np.sin(2.0 * np.pi * (years - 0.3 + phase))
    temperature = 21.0 + swing * wave + random.normal(0.0, 0.7, RUNS)
    noted = temperature + random.normal(0.0, 0.15, RUNS)
    instrument = random.choice(3, RUNS, p=[0.6, 0.25, 0.15])
    crash = int(random.integers(8, RUNS - 8)) if random.random() < 0.5 else -1
    names = list(FIGURES)
    wear = {n: random.choice([-1, 1]) * 10 ** random.uniform(-7.5, -5.1) for n in names}
    value = {n: random.normal(0.0, 3e-6) for n in names}
    spread = {n: 10 ** random.uniform(-6.3, -5.8) for n in names}
    thermal = {n: random.normal(0.0, 0.4e-6) for n in names}
    lagging = {n: random.normal(0.0, 0.6e-6) for n in names}
    made = Machine([], [], {}, {n: [] for n in names}, {n: [] for n in names}, thermal)
    repairs, patience = 0, random.integers(2, 6)
    for run in range(RUNS):
        ago = years[run] - years[run - 1] if run else 0.0
        before = dict(value)
        value = {n: value[n] + wear[n] * ago for n in names}
        jumps = {}
        if run == crash:
            for n in random.choice(names, random.integers(2, 5), replace=False):
                jumps[n] = random.choice([-1, 1]) * random.uniform(8e-6, 30e-6)
                if random.random() < 0.3:
                    wear[n] *= random.uniform(1.5, 3.0)
        elif repairs < 2 and any(abs(before[n]) > REPAIRED_FROM for n in names):
            patience -= 1
            if patience <= 0 and RUNS - run > 6:
                repairs, patience = repairs + 1, random.integers(4, 10)
                off = [n for n in names if abs(before[n]) > 0.5 * REPAIRED_FROM]
                jumps = {n: -before[n] * random.uniform(0.8, 1.0) for n in off}
        if jumps:
            made.events.append(run)
            made.jumps[run] = {n: abs(jumps[n]) / spread[n] for n in jumps}
            value = {n: value[n] + jumps.get(n, 0.0) for n in names}
        slip = random.normal(0.0, 8.0) if random.random() < 0.01 else 0.0
        for n in names:
            made.level[n].append(value[n])
            made.slope[n].append(wear[n])
            own = spread[n] * random.uniform(0.2, 1.2)
            noise = random.standard_t(4) / np.sqrt(2.0) if harsh else random.normal()
            seen = (
                value[n]
                + thermal[n] * (temperature[run] - 21.0)
                + lagging[n] * np.cos(2.0 * np.pi * (years[run] - 0.3))
                + FIGURES[n] * scales[instrument[run]]
                + spread[n] * (noise + slip)
                + random.normal(0.0, own)
            )
            made.rows.append(
                {
                    "time": BEGIN + timedelta(days=365.2425 * float(years[run])),
                    "machine": f"machine {number}",
                    "run_id": f"{number}-{run}",
                    "kind": "volume" if n == "largest in volume" else "result",
                    "method": "least_squares",
                    "name": n,
                    "unit": "m",
                    "value": float(seen),
                    "standard_uncertainty": float(own),
                    "scatter_standard_uncertainty": None,
                    "expanded_uncertainty": float(1.96 * own),
                    "layout": None,
                    "instrument": "laser",
                    "instrument_serial_number": f"L{instrument[run]}",
                    "material_temperature_degC": float(noted[run]),
                    "material_temperature_range_K": 0.5,
                }
            )
    return made


def fleet(seed: int, harsh: bool) -> list[Machine]:
    """Simulate the machines of one seed, which three instruments measure."""
    random = np.random.default_rng(seed)
    scales = random.normal(0.0, SCALE, 3)
    return [machine(number, random, scales, harsh) for number in range(MACHINES)]


def read(made: Machine, stated_scales: bool) -> dict:
    """Read the history of a machine after every run, and compare it with what is known."""
    from stepdiag_ros.archive.histories import histories_of
    from stepdiag_ros.archive.stated import Stated

    score: dict = {"events": [], "final": [], "false": 0, "final_false": 0, "crossings": []}
    scales = {f"L{one}": SCALE for one in range(3)} if stated_scales else {}
    stated = Stated(tolerances={"": dict.fromkeys(FIGURES, TOLERANCE)}, scales=scales)
    travels = {made.rows[0]["machine"]: TRAVELS}
    reported: set[tuple[str, int]] = set()
    found: set[int] = set()
    for runs in range(1, RUNS + 1):
        rows = made.rows[: runs * len(FIGURES)]
        (history,) = histories_of(rows, stated, travels)
        new = [(f.name, c.run) for f in history.figures for c in f.trend.changed()]
        for name, run in new:
            near = [one for one in made.events if abs(one - run) <= 2]
            found.update(one for one in near if runs <= one + 3)
            if not near and all(n != name or abs(r - run) > 2 for n, r in reported):
                score["false"] += 1
                reported.add((name, run))
        if runs == RUNS:
            score["final"] = [any(abs(r - e) <= 2 for _, r in new) for e in made.events]
            score["final_false"] = sum(
                all(abs(one - run) > 2 for one in made.events) for _, run in new
            )
        if runs in (20, 30, 40, 50):
            score["crossings"] += [_crossing(made, f, runs) for f in history.figures]
    score["events"] = [[max(made.jumps[e].values()), e in found] for e in made.events]
    return score


def _crossing(made: Machine, figure, runs: int) -> list:
    """Return what is stated of a crossing, and whether it holds; None where nothing is stated."""
    slope = made.slope[figure.name][runs - 1]
    warm = made.thermal[figure.name] * np.nan_to_num(figure.trend.temperature - 21.0)
    level = made.level[figure.name][runs - 1] + warm
    when = (np.copysign(TOLERANCE, slope) - level) / slope if abs(level) <= TOLERANCE else 0.0
    crossing = figure.trend.crossing
    if crossing.outlook.name == "INTERVAL":
        return [crossing.outlook.name, bool(crossing.earliest <= when <= crossing.latest)]
    if crossing.outlook.name == "OUTSIDE":
        return [crossing.outlook.name, bool(abs(level) > TOLERANCE)]
    if np.isfinite(crossing.earliest):
        return [crossing.outlook.name, bool(when >= crossing.earliest)]
    return [crossing.outlook.name, None]


def measured(
    seed: int, harsh: bool = False, machines: int = MACHINES, stated_scales: bool = True
) -> dict:
    """Return the figures of one seed."""
    scores = [read(one, stated_scales) for one in fleet(seed, harsh)[:machines]]
    events = [one for score in scores for one in score["events"]]
    final = [one for score in scores for one in score["final"]]
    decades = machines * YEARS / 10.0
    crossings = [one for score in scores for one in score["crossings"]]
    holds = {}
    for name in sorted({one[0] for one in crossings}):
        known = [one[1] for one in crossings if one[0] == name]
        judged = [one for one in known if one is not None]
        holds[name] = [sum(judged), len(judged), len(known)]
    return {
        "seed": seed,
        "harsh": harsh,
        "changes": len(events),
        "found_within_two_runs": sum(one[1] for one in events),
        "found_in_the_end": sum(final),
        "false_alarms_per_machine_and_decade": sum(s["false"] for s in scores) / decades,
        "false_in_the_end_per_machine_and_decade": sum(s["final_false"] for s in scores) / decades,
        "missed_sizes": sorted(round(size, 1) for size, seen in events if not seen),
        "holds, judged, all": holds,
    }


def main() -> None:
    """Measure, and print one JSON object a seed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[11, 12, 13])
    parser.add_argument("--harsh", action="store_true", help="heavy tails and crowded runs")
    parser.add_argument("--no-scales", action="store_true", help="the owner states no scale")
    parser.add_argument("--machines", type=int, default=MACHINES)
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    with ProcessPoolExecutor(arguments.workers) as pool:
        every = [
            pool.submit(
                measured, seed, arguments.harsh, arguments.machines, not arguments.no_scales
            )
            for seed in arguments.seeds
        ]
        for one in every:
            print(json.dumps(one.result()), flush=True)


if __name__ == "__main__":
    main()
