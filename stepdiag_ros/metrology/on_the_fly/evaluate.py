"""From the record of a pass to the values of its nodes."""

from math import nan

import numpy as np

from stepdiag_ros.metrology.geometry import Vector, inner
from stepdiag_ros.metrology.on_the_fly.motion import Motion, faults_of_motion, motion_of
from stepdiag_ros.metrology.on_the_fly.record import (
    Finding,
    Instants,
    MovingPass,
    NodeSource,
    PassFault,
    PassRecord,
    Places,
    refused,
)
from stepdiag_ros.metrology.on_the_fly.regression import Intervals, Solution, solve
from stepdiag_ros.metrology.time_alignment import LineRecord, line_offset

FIRST_LOST = 2
"""BEAM_LOST and all above it of InterferometerReading.msg lose the zero."""
_UNEVEN = 0.4
"""Part of the period of the readings by which a time stamp may differ from its place."""
_MOST_JUMP = 5.0
"""Standard uncertainties by which the delay of one move may differ from that of the others."""
_FARTHEST = 0.1
"""Part of a move by which its displacement may be off: no misalignment does that."""
MOST_JITTER = 0.5e-3
"""s: with more, readings and positions are not of the same clock."""


def evaluate_pass(record: PassRecord) -> MovingPass:
    """Return the values of a pass's nodes with their covariance, and what was found wrong.

    A move with a fault, and the node it leads to, have no value. A fault of the clocks, of the
    whole stream of positions or of all corners refuses the pass.
    """
    nodes = record.moves + 1
    motion = motion_of(record)
    if isinstance(motion, Finding):
        return refused(nodes, motion)
    findings = [*faults_of_motion(record, motion), *_clock_steps(record)]
    if whole := [finding for finding in findings if not finding.moves]:
        return refused(nodes, *[f for f in findings if f.moves], *whole)
    offset = line_offset(
        LineRecord(
            record.position_times,
            inner(record.positions - record.targets[0], record.direction),
            *_good(record),
        )
    )
    if offset.reason:
        return refused(nodes, *findings, Finding(PassFault.NOT_JOINED, offset.reason))
    # Readings of which interval: 0 until the first move, then from onset to onset.
    late = round(offset.offset * 1e9)
    onsets = np.round(motion.onsets * 1e9).astype(np.int64) + motion.origin + late
    number = np.searchsorted(onsets, record.reading_times, side="right")
    findings += _reading_faults(record, number)
    bad = {move for finding in findings for move in finding.moves}
    if len(bad - {0}) == record.moves:
        return refused(nodes, *findings)
    solution = solve(record, motion, Intervals(number, frozenset(bad)), offset.offset)
    if isinstance(solution, Finding):
        return refused(nodes, *findings, solution)
    if against := _disagreement(record, solution):
        return refused(nodes, *findings, against)
    return _passed(record, motion, number, findings, solution)


def _clock_steps(record: PassRecord) -> list[Finding]:
    """Find readings whose time stamps do not go on as their numbers do."""
    times, numbers = np.diff(record.reading_times), np.diff(record.sequences)
    if len(times) == 0:
        return [Finding(PassFault.READINGS_MISSING, "there are no readings of the pass")]
    if np.any(numbers <= 0):
        text = "the interferometer was started again: its zero is lost; measure the line again"
        return [Finding(PassFault.BEAM_LOST, text)]
    period = float(np.median(times / numbers))
    off = times - numbers * period
    worst = int(np.argmax(np.abs(off)))
    if abs(off[worst]) <= _UNEVEN * period:
        return []
    text = (
        f"the clock of the readings stepped by {off[worst] * 1e-6:.3g} ms (their period is"
        f" {period * 1e-6:.3g} ms); measure the line again"
    )
    return [Finding(PassFault.CLOCK_STEP, text)]


def _good(record: PassRecord) -> tuple[Instants, Vector]:
    """Return times and displacements of the readings before the first that cannot be used."""
    bad = (record.statuses >= FIRST_LOST) | ~np.isfinite(record.displacements)
    part = slice(int(np.argmax(bad)) if bad.any() else len(bad))
    return record.reading_times[part], record.displacements[part]


def _reading_faults(record: PassRecord, number: Places) -> list[Finding]:
    found = []
    lost = np.flatnonzero(record.statuses >= FIRST_LOST)
    if len(lost):
        first = int(number[lost[0]])
        text = f"the zero is lost: the beam was lost in move {first}; measure the line again"
        after = frozenset(range(first, record.moves + 1))
        found.append(Finding(PassFault.BEAM_LOST, text, after))
    gaps = np.flatnonzero(np.diff(record.sequences) != 1)
    unknown = np.flatnonzero(~np.isfinite(record.displacements) & (record.statuses < FIRST_LOST))
    hurt = {int(number[i + shift]) for i in gaps for shift in (0, 1)}
    hurt |= {int(number[i]) for i in unknown}
    low = np.flatnonzero(record.statuses == 1)
    hurt |= {int(number[i]) for i in low}
    if hurt:
        text = (
            f"readings are missing, weak or without known air in move"
            f" {', '.join(map(str, sorted(hurt)))}; measure the line again"
        )
        moves = frozenset(hurt)
        found.append(Finding(PassFault.READINGS_MISSING, text, moves))
    return found


def _disagreement(record: PassRecord, solution: Solution) -> Finding | None:
    """Find readings and positions that are not of one clock, or not of one machine."""
    if solution.rest_noise > record.noise_limit:
        text = (
            f"the readings scatter by {solution.rest_noise * 1e6:.3g} µm in the corners, above the"
            f" limit of {record.noise_limit * 1e6:g} µm"
        )
        return Finding(PassFault.NOT_JOINED, text)
    if solution.step > _FARTHEST:
        text = (
            f"the displacement of a move is off by {100.0 * solution.step:.2g} % of its way: the"
            " beam is not along the line, or counts are lost"
        )
        return Finding(PassFault.NOT_JOINED, text)
    if solution.jitter > MOST_JITTER:
        text = (
            f"readings and positions differ by {solution.jitter * 1e3:.2g} ms at random (at most"
            f" {MOST_JITTER * 1e3:g} ms): a clock stepped or its stamps are rough; measure the line"
            " again"
        )
        return Finding(PassFault.CLOCK_STEP, text)
    worst, jump, uncertainty = solution.delay_jump
    if not abs(jump) > _MOST_JUMP * uncertainty:
        return None
    return Finding(
        PassFault.CLOCK_STEP,
        f"the delay between readings and positions changed by {jump * 1e6:.3g} µs (standard"
        f" uncertainty {uncertainty * 1e6:.2g} µs) at move {worst}: a clock stepped; measure the"
        " line again",
    )


def _passed(
    record: PassRecord,
    motion: Motion,
    number: Places,
    findings: list[Finding],
    solution: Solution,
) -> MovingPass:
    reasons = [""] * (record.moves + 1)
    for finding in findings:
        for move in finding.moves:
            reasons[move] = reasons[move] or finding.text
    invalid = np.array([bool(reason) for reason in reasons])
    displacement = np.where(invalid, nan, solution.nodes)
    covariance = np.where(invalid[:, None] | invalid[None, :], nan, solution.covariance)
    return MovingPass(
        displacement=displacement,
        covariance=covariance,
        reasons=tuple(reasons),
        findings=tuple(findings),
        sources=tuple(
            _source(record, motion, number, node, solution) for node in range(record.moves + 1)
        ),
        delays=solution.delays,
        vibration=solution.vibration,
        common=solution.common,
        noise=solution.noise,
        curves=solution.curves,
    )


def _source(
    record: PassRecord, motion: Motion, number: Places, node: int, solution: Solution
) -> NodeSource:
    first, last = np.searchsorted(number, (node, node + 1))
    begin = motion.at[0] if node == 0 else motion.ends[node - 1]
    end = motion.onsets[node] if node < record.moves else motion.at[-1]
    stay = motion.origin + round((0.5 * (begin + end) + solution.delay) * 1e9)
    inside = slice(int(first), max(int(last), int(first) + 1))
    times, numbers = record.reading_times[inside], record.sequences[inside]
    return NodeSource(
        time=stay,
        readings=int(last - first),
        first_sequence=int(numbers[0]) if len(numbers) else 0,
        last_sequence=int(numbers[-1]) if len(numbers) else 0,
        start=int(times[0]) if len(times) else stay,
        end=int(times[-1]) if len(times) else stay,
    )
