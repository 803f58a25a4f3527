"""Whether what depends on the sense of an axis lasts, as backlash does, or fades.

An axis that stands short after it turned round, and then creeps to its place in minutes, reads
nearly as backlash where it turns round sooner than it creeps. The name alone would be wrong; slower
lines show which of the two it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from stepdiag_ros.metrology.discrepancy.baseline import Whitened
from stepdiag_ros.metrology.discrepancy.described import WITHOUT_A_NAME
from stepdiag_ros.metrology.discrepancy.findings import (
    AMBIGUOUS,
    NAMED,
    Candidate,
    Diagnosis,
    RunnerUp,
)
from stepdiag_ros.metrology.discrepancy.loose import span_beyond, unit_span
from stepdiag_ros.metrology.discrepancy.rotation_finding import shaken_by
from stepdiag_ros.metrology.discrepancy.selection import EVIDENCE_RATIO
from stepdiag_ros.metrology.discrepancy.siblings import ONE_OF_AXES
from stepdiag_ros.metrology.discrepancy.structure import FADING, RATIO_OF_CONSTANTS, creeps
from stepdiag_ros.metrology.effects.domain import since_reversal
from stepdiag_ros.metrology.effects.learned_shape import EFFECT as LEARNED
from stepdiag_ros.metrology.effects.learned_shape import driver, fading_time, product_of
from stepdiag_ros.metrology.effects.stops import Stops
from stepdiag_ros.metrology.geometry import AXES, Vector

_MOST = 0.9
"""Share of the stops that come sooner after a reversal than the longest time constant."""
_SAME = 1e-9
"""1 - |cosine| of two changes of all readings that differ by rounding only."""


@dataclass(frozen=True)
class Fading:
    """What fades after an axis turned round, as the rival of what lasts.

    Attributes:
        candidate: with the time constant that fits best.
        gain: what χ² loses by it, beside the other findings.
        odds: of it, with any time constant, against what lasts.
    """

    candidate: Candidate
    gain: float
    odds: float


def fading(
    lasting: Candidate, others: Sequence[Candidate], problem: Whitened, stops: Stops
) -> Fading | None:
    """Return the rival of a candidate that lasts as long as an axis keeps its sense.

    Time constants are equally likely, from the time between stops to that since a reversal at
    most stops; what fades more slowly lasts, for this run.

    Args:
        lasting: the named candidate.
        others: that act beside it.
        problem: whitened, the baseline projected out.
        stops: of the run.

    Returns:
        the rival; None where the candidate does not depend on a sense alone, or no time is known.
    """
    if lasting.setting.keys() != ONE_OF_AXES or not np.all(np.isfinite(stops.time)):
        return None
    axis = lasting.setting["axis"]
    raw = lasting.effect.columns(lasting.setting, stops)
    along = stops.direction[:, AXES.index(axis)]
    if raw.shape[1] != 1 or not _same(
        raw[:, 0], along * product_of(f"sense {axis.lower()}", stops)
    ):
        return None
    longest = float(np.quantile(since_reversal(stops, axis), _MOST))
    shapes = creeps(axis.lower(), stops, RATIO_OF_CONSTANTS, longest)
    fades = [along * product_of(shape, stops) for shape in shapes]
    free = [lasting.effect.unknown(lasting.setting, stops), *(one.free(stops) for one in others)]
    beside = span_beyond(problem, np.column_stack(free))
    gap = problem.gap - beside @ (beside.T @ problem.gap)
    columns = problem.left_of(np.column_stack([raw, *fades]))
    columns -= beside @ (beside.T @ columns)
    gains = np.array([float(np.sum((unit_span(one[:, None]).T @ gap) ** 2)) for one in columns.T])
    ahead = 0.5 * (gains[1:] - gains[0])
    best = int(np.argmax(ahead))
    setting = {"acts_on": axis, "shape": shapes[best]}
    return Fading(
        Candidate(LEARNED, setting, LEARNED.label(setting)),
        float(gains[1 + best]),
        float(np.exp(logsumexp(ahead) - np.log(len(shapes)) - FADING)),
    )


def _same(one: Vector, other: Vector) -> bool:
    lengths = np.linalg.norm(one) * np.linalg.norm(other)
    return bool(lengths > 0.0 and abs(one @ other) > (1.0 - _SAME) * lengths)


def or_fading(diagnosis: Diagnosis, problem: Whitened) -> Diagnosis:
    """Return a diagnosis that says where what it names may as well fade.

    Args:
        diagnosis: by the effects of the catalogue.
        problem: whitened, rotations of all axes not in its baseline.
    """
    if diagnosis.verdict not in (NAMED, AMBIGUOUS):
        return diagnosis
    for place, finding in enumerate(diagnosis.findings):
        others = [one.candidate for one in diagnosis.findings if one is not finding]
        rival = fading(finding.candidate, others, problem, diagnosis.stops)
        if rival is not None and rival.odds * EVIDENCE_RATIO > 1.0:
            diagnosis = shaken_by(_runner_up(rival), _without(rival, diagnosis, place), place)
    return diagnosis


def _runner_up(rival: Fading) -> RunnerUp:
    axis, shape = rival.candidate.setting["acts_on"], rival.candidate.setting["shape"]
    why = (
        f"fades in about {fading_time(shape):.2g} s after {axis} turned round: odds"
        f" {rival.odds:.2g} to 1, too close to rule out"
    )
    chance = rival.odds / (1.0 + rival.odds)
    return RunnerUp(rival.candidate.label, rival.gain, chance, why, ambiguous=True)


def _without(rival: Fading, diagnosis: Diagnosis, place: int) -> Diagnosis:
    """Return a diagnosis without the formula that says what a rival of a finding says."""
    words = driver(rival.candidate.setting["shape"])
    findings = list(diagnosis.findings)
    kept = [
        one
        for one in findings[place].runners_up
        if not (one.label.startswith(WITHOUT_A_NAME) and one.label.endswith(f"{words})"))
    ]
    findings[place] = replace(findings[place], runners_up=tuple(kept))
    return replace(diagnosis, findings=tuple(findings))
