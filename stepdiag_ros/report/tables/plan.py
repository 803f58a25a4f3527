"""A plan before it is run as text tables: what it costs, what it will determine and what not."""

from itertools import groupby
from math import isfinite

from stepdiag_ros import __version__
from stepdiag_ros.metrology.checking import FASTEST_FEED
from stepdiag_ros.metrology.geometry import AXES
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.metrology.units import IN_MICRO, IN_MILLI
from stepdiag_ros.planning.assessment import Assessment
from stepdiag_ros.planning.candidates import PURPOSES
from stepdiag_ros.planning.duration import LineDuration, PlanDuration
from stepdiag_ros.planning.mirror import mirror_width
from stepdiag_ros.planning.proposal import PlanProposal, hours, size_words
from stepdiag_ros.planning.request import PlanCandidate
from stepdiag_ros.run.feasibility import least_clearance
from stepdiag_ros.text.console import PlainConsole
from stepdiag_ros.text.numbers import UNKNOWN, plain
from stepdiag_ros.text.table import Table, new_table


def box_table(assessment: Assessment) -> Table:
    """Return the measured box and its grid beside the machine's travel, in mm."""
    table = new_table("Measured box / mm", "axis", "from", "to", "step", "travel from", "to")
    volume, machine = assessment.plan.volume, assessment.machine
    for axis, letter in enumerate(AXES):
        nodes = volume.nodes(axis)
        values = (
            nodes[0],
            nodes[-1],
            volume.step[axis],
            machine.travel_low_m[axis],
            machine.travel_high_m[axis],
        )
        table.add_row(letter, *(f"{value * IN_MILLI:.6g}" for value in values))
    return table


def duration_table(duration: PlanDuration) -> Table:
    """Return the duration by setup, and in all."""
    shifted = next((line.setup for line in duration.lines if "@" in line.setup), "")
    name, _, place = shifted.partition("@")
    how = f"; {shifted}: {name} shifted by {place.replace(',', ', ')} m (X, Y, Z)" if name else ""
    table = new_table(
        f"Duration{how}", "setup", "passes", "stops", "alignment", "moves", "dwells", "together"
    )
    for setup, lines in groupby(duration.lines, key=lambda line: line.setup):
        table.add_row(setup, *_duration_cells(list(lines)))
    table.add_section()
    table.add_row("in all", *_duration_cells(list(duration.lines)))
    return table


def _duration_cells(lines: list[LineDuration]) -> list[str]:
    return [
        str(len(lines)),
        str(sum(line.stops for line in lines)),
        _minutes(sum(line.alignment for line in lines)),
        _minutes(sum(line.moves + line.positioning for line in lines)),
        _minutes(sum(line.dwells for line in lines)),
        _minutes(sum(line.total for line in lines)),
    ]


def _minutes(seconds: float) -> str:
    return f"{seconds / 60.0:.1f} min"


def uncertainty_table(assessment: Assessment) -> Table:
    """Return the expected expanded uncertainties, without and with rotations."""
    size = f"rotations {_microradians(assessment)}"
    table = new_table(
        "Expected uncertainty U (95 %): least_squares with plausible rotations, and by noise alone",
        *("", "unit", f"least_squares, {size}", "noise alone", "rigid_body, noise alone"),
    )
    plain_model, rotating = assessment.expectation, assessment.rotating
    printed = assessment.with_rotations
    for words, group, unit in (
        ("positioning, largest over the nodes", "positioning", "µm"),
        ("straightness, largest deviation from its line", "straightness", "µm"),
        ("squareness", "squareness", "µm/m"),
        ("angular error, largest over the nodes", "angular", "µm/m"),
    ):
        without = getattr(plain_model, group)
        within = {} if rotating is None else getattr(rotating, group)
        said = getattr(printed, group)
        for number, name in enumerate(within or without):
            table.add_row(
                f"{name}  {words}" if number == 0 else name,
                unit,
                _expanded(said[name]) if name in said else "not estimated",
                _expanded(without[name]) if name in without else "not estimated",
                _expanded(within[name]) if name in within else UNKNOWN,
            )
    table.add_row(
        "mirror's point, anywhere in the box, each direction",
        "µm",
        _expanded(printed.volumetric),
        _expanded(plain_model.volumetric),
        "",
    )
    return table


def _microradians(assessment: Assessment) -> str:
    return f"{assessment.machine.rotations * IN_MICRO:g} µrad"


def _rates(machine: Machine) -> str:
    """Return the rates of drift, and which of them are the usual ones."""
    told = {
        "zero_drift_m_per_s": (machine.zero_drift_m_per_s, Machine.zero_drift_m_per_s),
        "growth_per_s": (machine.growth_per_s, Machine.growth_per_s),
    }
    return ", ".join(
        f"{key} {rate:g}{', the default' if rate == usual else ''}"
        for key, (rate, usual) in told.items()
    )


def _expanded(standard_uncertainty: float) -> str:
    return plain(COVERAGE_FACTOR * standard_uncertainty * IN_MICRO, 3)


def visibility_table(assessment: Assessment) -> Table:
    """Return what the plan shows of each error, without and with rotations in the model."""
    chain = assessment.machine.chain
    table = new_table(
        "Visibility", "error", "without rotations", f"with rotations ({chain or '?'})"
    )
    table.columns[1].number = table.columns[2].number = False
    table.columns[1].wraps = table.columns[2].wraps = True
    without = {row.name: row.words for row in assessment.seen.rows}
    if assessment.seen_rotating is None:
        for name, words in without.items():
            table.add_row(name, words, "the chain is not known")
        return table
    for row in assessment.seen_rotating.rows:
        table.add_row(row.name, without.get(row.name, "taken as 0"), row.words)
    return table


def alternatives_table(proposal: PlanProposal) -> Table:
    """Return the frontier of uncertainty against time, with the chosen plan marked."""
    purpose = PURPOSES[proposal.request.purpose]
    table = new_table(
        "Quicker and better plans: expected U (95 %), and what each minute more than the row above"
        " buys",
        *("lines", "blocks", "repeats", "align", "duration", "U", "each minute"),
    )
    shown = [one for one in proposal.front if one is not proposal.chosen]
    before: PlanCandidate | None = None
    for one in sorted((*shown, proposal.chosen), key=lambda one: one.duration.total):
        mark = "  <- chosen" if one is proposal.chosen else ""
        gained = ""
        if before is not None and one.duration.total > before.duration.total:
            minutes = (one.duration.total - before.duration.total) / 60.0
            gained = size_words((before.uncertainty - one.uncertainty) / minutes, purpose.unit)
        table.add_row(
            one.words + mark,
            str(one.plan.volume.blocks),
            str(_repeats(one)),
            str(one.duration.alignments),
            hours(one.duration.total),
            size_words(one.uncertainty, purpose.unit),
            gained,
        )
        before = one
    return table


def _repeats(candidate: PlanCandidate) -> int:
    return max(line.repeat for line in candidate.plan.lines) + 1


def _room_sentences(assessment: Assessment) -> list[str]:
    """Say how much room the plan takes: of the travel, and of the mirror."""
    distance, axis = least_clearance(assessment.plan, assessment.machine)
    sentences = [
        "All stops and run-ups are within the machine's travel; the nearest end of it is"
        f" {distance * IN_MILLI:.3g} mm away ({axis})."
    ]
    if width := mirror_width(assessment.plan):
        sentences.append(
            f"The step diagonals move the mirror sideways by {width * IN_MILLI:.1f} mm: it must be"
            " at least that much wider than the beam."
        )
    return sentences


def _box_with_lines(assessment: Assessment) -> list[str]:
    """Say what lines from the first corner would do to the errors in the whole box."""
    if not assessment.without_line:
        return []
    now = assessment.with_rotations.volumetric
    then = assessment.without_line[0].volumetric_with_line
    if not isfinite(now) or not isfinite(then):
        return []
    sizes = [size_words(COVERAGE_FACTOR * one, "m") for one in (now, then)]
    why = ""
    if then > now:
        why = (
            ": such a line gives the error at the first corner alone, and the rotations that these"
            " lines do not show act from there with the whole length of the box"
        )
    count = "this line" if len(assessment.without_line) == 1 else "these lines"
    return [
        f"With {count}, U of the error of the mirror's point anywhere in the box would be"
        f" {sizes[1]} instead of {sizes[0]}{why}."
    ]


def summary_sentences(assessment: Assessment, proposal: PlanProposal | None) -> list[str]:
    """Return what comes first: how long, how many, how well, and why this plan."""
    duration = assessment.duration
    repeats = "each line one way"
    if len({line.direction for line in assessment.plan.lines}) > 1:
        repeats = "in both directions"
    sentences = [
        f"{len(assessment.plan.lines)} passes, {repeats}, with {duration.stops} stops and "
        f"{duration.alignments} alignments take {hours(duration.total)}: "
        f"{hours(duration.running)} of machine time and {hours(duration.alignment)} of "
        f"alignment."
        if duration.alignments
        else f"{len(assessment.plan.lines)} passes, {repeats}, with {duration.stops} stops take "
        f"{hours(duration.total)}; the plan waits for no alignment.",
    ]
    assumed = duration.assumptions
    sentences.append(
        f"Assumed: alignment {assumed.linear_alignment_s / 60.0:g} min for a linear line, "
        f"{assumed.diagonal_alignment_s / 60.0:g} min for a diagonal; in position "
        f"{assessment.machine.position_hold_s + assumed.settling_s:g} s after a move; every stop "
        f"settles at once; standard uncertainty of a "
        f"{'node on the fly' if assessment.plan.on_the_fly else 'stop'} "
        f"{assessment.stop_uncertainty * IN_MICRO:.3g} µm."
    )
    sentences += _room_sentences(assessment)
    sentences += [
        f"{one.axis} has no linear line from the first corner of the box: U of its positioning"
        f" {one.curve} is {size_words(COVERAGE_FACTOR * one.uncertainty, 'm')}. With such a line,"
        f" which takes {hours(one.seconds)}, it would be"
        f" {size_words(COVERAGE_FACTOR * one.with_line, 'm')}."
        for one in assessment.without_line
    ]
    sentences += _box_with_lines(assessment)
    if proposal is not None:
        purpose, chosen = PURPOSES[proposal.request.purpose], proposal.chosen
        expected = size_words(chosen.uncertainty, purpose.unit)
        about = " with all rotations in the model, by the noise of the stops alone"
        if not purpose.rotations:
            about = (
                f" with pitch, yaw and roll of {_microradians(assessment)} (rotations, as in the"
                " machine file or its default), as far as these lines do not determine them"
            )
        sentences.append(
            f"For {purpose.words}: expected uncertainty (95 %) of {proposal.figure}"
            f" {expected}"
            f"{about}. This plan is {proposal.reason}."
        )
        sentences += _assumption_sentences(proposal)
        if chosen.limited:
            sentences.append(f"What limits it most: {chosen.limited}.")
        if isfinite(chosen.drift):
            sentences.append(
                f"Drift at the machine's rate ({_rates(assessment.machine)}) may add"
                f" {size_words(chosen.drift, purpose.unit)} in this order of the lines."
            )
        sentences += [f"Not taken: {words}." for words in proposal.discarded]
    return sentences


def _assumption_sentences(proposal: PlanProposal) -> list[str]:
    """Say that the wish rests on an assumption about rotations, and what U is without it."""
    assumed, unit = proposal.assumed, PURPOSES[proposal.request.purpose].unit
    if assumed is None:
        return []
    without = "the lines do not determine it, and U is unknown"
    if isfinite(assumed.without):
        without = f"U is {size_words(assumed.without, unit)} by the noise of the stops alone"
    usual = ""
    if isfinite(assumed.with_usual):
        usual = (
            f" With the default of {assumed.usual * IN_MICRO:g} µrad, U is"
            f" {size_words(assumed.with_usual, unit)}."
        )
    return [
        "This is an assumption, not a measurement: the wish is reached only if pitch, yaw and roll"
        f" are about {assumed.size * IN_MICRO:g} µrad or less.{usual} Without any assumption"
        f" about them, {without}."
    ]


def print_assessment(
    assessment: Assessment, console: PlainConsole, proposal: PlanProposal | None = None
) -> None:
    """Print all that is known of a plan before it is run.

    Args:
        assessment: of the plan.
        console: where to.
        proposal: how the plan was found; None for a plan that was there.
    """
    console.sentence(assessment.plan.name)
    for text in summary_sentences(assessment, proposal):
        console.sentence(text)
    console.print()
    tables = [box_table(assessment), duration_table(assessment.duration)]
    if proposal is not None and proposal.considered > 1:
        tables.append(alternatives_table(proposal))
    for table in (*tables, uncertainty_table(assessment), visibility_table(assessment)):
        console.print(table)
    if assessment.warnings:
        console.print("Better change", style="bold")
        for text in assessment.warnings:
            console.sentence(f"- {text}")
        console.print()
    console.print("What this plan will not determine", style="bold")
    for text in assessment.limits:
        console.sentence(f"- {text}")


def head_of_plan(assessment: Assessment, proposal: PlanProposal) -> list[str]:
    """Return the sentences that stand at the head of a proposed plan's file."""
    feed_limit = assessment.machine.feed_limit_m_per_s
    # Of a machine of which only the travel is known, no feed limit is.
    limit = f" Feed limit {feed_limit * 60.0:g} m/min." if feed_limit < FASTEST_FEED else ""
    return [
        f"Proposed by stepdiag {__version__} for {assessment.machine.name}.{limit}",
        *summary_sentences(assessment, proposal),
        *assessment.limits,
        "The keys are explained in config/plans/demo.yaml.",
    ]
