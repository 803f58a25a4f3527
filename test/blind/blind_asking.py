"""The workflow's side of the blind test: it is shown a folder, and asked; what it says is kept.

Nothing here knows what is hidden.
"""

import csv
import signal
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from blind_plans import box_places
from blind_words import Entry

NO_ANSWER = "NO ANSWER"
"""Stands for the verdict where none came in time."""
REFUSED = "REFUSED"
"""Stands for the verdict where the table was not taken."""
CRASH = "CRASH"
"""Stands for the verdict where an error came that is no refusal."""
LONGEST = 120
"""Processor seconds after which a workflow has no answer; the issue allows 20 in the middle."""


class NoAnswerError(Exception):
    """The workflow has not come to a verdict in time."""


@contextmanager
def limited(seconds):
    """Give up after some seconds of processor time; acts in the main thread of a process."""

    def give_up(_number, _frame):
        raise NoAnswerError

    before = signal.signal(signal.SIGPROF, give_up)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def imported(folder):
    """Import a run table into a bag as ``stepdiag import`` does, and read the bag.

    A folder with ``nominal.csv`` holds a run that was measured live: its readings, which no table
    reader would pass, go to the workflow as they are.
    """
    from stepdiag_ros.bags.run import load_run
    from stepdiag_ros.bags.table import import_table, load_table

    folder = Path(folder)
    if (folder / "nominal.csv").exists():
        measurement = load_table(folder / "nominal.csv").measurement
        with (folder / "run.csv").open(newline="") as file:
            readings = np.array([float(row["reading_m"]) for row in csv.DictReader(file)])
        return _with_readings(measurement, readings)
    bag = folder / "run.mcap"
    if not bag.exists():
        import_table(folder / "run.csv", None, bag)
    return load_run(bag).measurement


def _with_readings(measurement, readings):
    lines, place = [], 0
    for line in measurement.lines:
        count = len(line.displacement)
        lines.append(replace(line, displacement=readings[place : place + count]))
        place += count
    return replace(measurement, lines=tuple(lines))


def asked(folder, **further):
    """Ask the workflow; return its diagnosis and the document that is kept of it.

    Both None and a document where the table was refused.
    """
    from stepdiag_ros.bags.errors import BagError, TableError

    try:
        measurement = imported(folder)
    except (BagError, TableError) as error:
        return None, {"verdict": REFUSED, "sentence": str(error), "findings": [], **_NOTHING}
    return diagnosed(measurement, **further)


_NOTHING = {"readings": 0, "seconds": 0.0, "where": [], "words": [], "untestable": []}


def diagnosed(measurement, **further):
    """Ask the workflow about a measurement; return its diagnosis and what is kept of it."""
    from stepdiag_ros.metrology.discrepancy.diagnose import diagnose

    # Of the processor, on one thread: whatever else the computer does, it does not count.
    begin = time.process_time()
    with limited(LONGEST):
        found = diagnose(measurement, **further)
    seconds = time.process_time() - begin
    named = {
        name for one in found.findings for name in (one.label, *one.ambiguous, *one.equivalent)
    }
    return found, {
        "verdict": found.verdict,
        "sentence": found.sentence,
        "where": list(found.where),
        "findings": [_finding(one) for one in found.findings],
        "partial": [_finding(one) for one in found.partial],
        "words": [list(entry) for entry, _, _ in entries_of(found.stops) if entry.label in named],
        "untestable": [
            list(entry)
            for entry, _, _ in entries_of(found.stops)
            if entry.label in found.not_testable
        ],
        "description": _description(found.description),
        "amounts": _amounts(found, measurement.volume) if found.verdict == "DESCRIBED" else None,
        "spanned": _spanned(found) if found.verdict in ("NAMED", "AMBIGUOUS") else None,
        "noise": found.noise,
        "correlation": found.noise_correlation,
        "chi_squared": [found.chi_squared_before, found.chi_squared_after],
        "degrees_of_freedom": [found.degrees_of_freedom_before, found.degrees_of_freedom_after],
        "lack_of_fit_p": [found.lack_of_fit_p_before, found.lack_of_fit_p_after],
        "tested": found.tested,
        "readings": len(found.residual_before),
        "seconds": seconds,
    }


def _description(found):
    if found is None:
        return None
    return {
        "dependences": [
            {
                "acts_on": one.acts_on,
                "drivers": list(one.drivers),
                "shapes": list(one.shapes),
                "p_value": one.p_value,
                "probability": one.probability,
                "rivals": [[acts_on, list(drivers)] for acts_on, drivers in one.rivals],
            }
            for one in found.dependences
        ],
        "nearest": found.nearest,
        "nearest_share": found.nearest_share,
    }


def _amounts(found, volume):
    """What a description says of the readings, and along the beams all over the box, m."""
    places = box_places(volume.step, volume.blocks, len(found.stops.time))
    everywhere = replace(found.stops, position=places)
    return {
        name: sum(
            one.candidate.effect.columns(one.candidate.setting, stops) @ list(one.sizes.values())
            for one in found.findings
        ).tolist()
        for name, stops in (("at_stops", found.stops), ("in_box", everywhere))
    }


def _spanned(found):
    """All that the named effects can do to the readings, a row for each size.

    None where one of them has its sizes only at random.
    """
    if any(one.candidate.effect.typical for one in found.findings):
        return None
    acting = [(one.candidate.effect, one.candidate.setting) for one in found.findings]
    return [
        row for effect, setting in acting for row in effect.columns(setting, found.stops).T.tolist()
    ]


def no_answer():
    return {**_NOTHING, "verdict": NO_ANSWER, "findings": [], "seconds": LONGEST}


def crashed(error):
    sentence = f"{type(error).__name__}: {error}"
    return {**_NOTHING, "verdict": CRASH, "sentence": sentence, "findings": []}


def _finding(one):
    return {
        "label": one.label,
        "effect": one.candidate.effect.name,
        "sizes": dict(one.sizes),
        "band": {name: list(ends) for name, ends in one.band.items()},
        "gain": one.gain,
        "p_value": one.p_value,
        "probability": one.probability,
        "group": list(one.group),
        "ambiguous": list(one.ambiguous),
        "equivalent": list(one.equivalent),
        "runners_up": [[other.label, other.probability] for other in one.runners_up[:5]],
    }


def entries_of(stops):
    """Every candidate of the catalogue in a run: (entry, effect, setting)."""
    from stepdiag_ros.metrology.effects import catalogue

    return [
        (Entry(effect.name, dict(setting), effect.label(setting)), effect, setting)
        for effect in catalogue().values()
        for setting in effect.settings(stops)
    ]


def held_out(folder, diagnosis):
    """χ² per degree of freedom of the same machine measured again, with the effects as found.

    That run fits its own curves and setups, and nothing of the effects.
    """
    known = [one.active for one in diagnosis.findings]
    _, again = asked(folder, known=known, catalogue=[])
    return again["chi_squared"][0] / again["degrees_of_freedom"][0]


def further_plan(folder, diagnosis):
    """Ask for the extra plan that tells apart what the run could not.

    Returns:
        the plan file's text, empty if none is proposed, and what is kept of the proposal.
    """
    from stepdiag_ros.planning.separation import proposal_text, propose_extra

    begin = time.process_time()
    with limited(LONGEST):
        proposal = propose_extra(imported(folder), diagnosis)
    kept = {
        "sentence": proposal.sentence,
        "certainty": proposal.certainty,
        "conditions": list(proposal.conditions),
        "left_open": [list(one.labels) for one in proposal.left_open],
        "duration": proposal.seconds,
        "seconds": time.process_time() - begin,
    }
    return (proposal_text(proposal) if proposal.plan is not None else ""), kept


def diagnosed_together(folders):
    """Ask the workflow about several runs of one machine; return what is kept of its verdict."""
    from stepdiag_ros.metrology.discrepancy.joint import joined

    return diagnosed(joined([_as_planned(folder) for folder in folders]))[1]


def _shared(plan):
    return yaml.safe_load(plan.read_text()).get("one_alignment_per_diagonal", False)


def _as_planned(folder):
    """Read a run, and of its plan whether the move orders of a diagonal share an alignment.

    A run table has no word for that; a bag of a live run has.
    """
    from stepdiag_ros.metrology.plan import alignment_of

    measurement, plan = imported(folder), Path(folder) / "plan.yaml"
    if not plan.exists() or not _shared(plan):
        return measurement
    lines = tuple(
        replace(line, setup=alignment_of(line.line, one_alignment_per_diagonal=True))
        for line in measurement.lines
    )
    return replace(measurement, lines=lines)
