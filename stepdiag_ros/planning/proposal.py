"""Seeks a plan: of all candidates that determine what is asked, the one that fits best."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.plan import Plan, Sampling, Volume
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.planning.candidates import (
    BLOCKS,
    PURPOSES,
    VOLUMETRIC,
    PlanPurpose,
    Scheme,
    lines_of,
    target_spacing,
    travel_box,
    volume_in,
)
from stepdiag_ros.planning.duration import Assumptions, PlanDuration, duration
from stepdiag_ros.planning.expectation import PlanExpectation, expect, worst
from stepdiag_ros.planning.moves import Point
from stepdiag_ros.run.feasibility import beyond_machine

_ENOUGH = 2.0
"""Without a wish, a plan is good enough whose uncertainty is within this factor of the best."""
_CLEARLY = 0.9
_SAME = 1.001
_VOLUMES_TRIED = 3
"""Numbers of blocks tried for a set of lines, from the fewest that keep to the spacing."""
_LEAST_BLOCKS_OF_STANDARDS = 4
"""Five targets at least (ISO 230-2:2014, 4.3.2)."""


_OVERRUN = 0.002
"""Of the purposes of a standard, m."""
_SETTLE = 0.5
"""Part of a dwell in which the machine calms down; the rest is averaged, s."""
_FREE_BY_HAND = 0.25
"""Share of a dwell that is neither, without a connection to the control."""


def sampling_with(dwell: float, by_hand: bool = False) -> Sampling:
    """Return how stops of a dwell are read: half a second, or half of it, to calm down.

    Args:
        dwell: s.
        by_hand: the dwell begins when the move is commanded to end, not when the machine is in
            position, and readings come now and then: a quarter of it stays free for the settling
            of the drives and the intervals between readings.
    """
    settle = min(_SETTLE, 0.25 * dwell if by_hand else 0.5 * dwell)
    standard = Sampling()
    return Sampling(
        dwell=dwell,
        settle=settle,
        window=dwell - settle - (_FREE_BY_HAND * dwell if by_hand else 0.0),
        longest_wait=max(standard.longest_wait, 3.0 * dwell),
    )


@dataclass(frozen=True)
class Request:
    """What is asked for.

    Attributes:
        purpose: a key of ``candidates.PURPOSES``.
        machine: its travel, chain and drives; a chain is needed for angular errors only.
        stop_uncertainty: standard uncertainty of a single stop, m.
        uncertainty: wanted expanded uncertainty (95 %) of the purpose's target, m or rad; None for
            no wish.
        time_limit: longest duration, alignments included, s; None for no limit.
        feed: of the moves, m/s.
        margin: kept free at every end of the travel, m.
        low: first corner of the box, m; that of the travel if None.
        high: last corner of the box, m.
        blocks: number of blocks; sought if None.
        spacing: largest distance between targets, m; the purpose's own if None.
        repeats: of every line; sought if None.
        directions: of every line; the purpose's own if None.
        overrun: with which lines begin, m; None: 2 mm for the purposes of a standard, else none.
        sampling: of the stops.
        assumptions: for the duration.
    """

    purpose: str
    machine: Machine
    stop_uncertainty: float = 0.1e-6
    uncertainty: float | None = None
    time_limit: float | None = None
    feed: float = 0.033
    margin: float = 0.005
    low: tuple[float, float, float] | None = None
    high: tuple[float, float, float] | None = None
    blocks: int | None = None
    spacing: float | None = None
    repeats: int | None = None
    directions: tuple[str, ...] | None = None
    overrun: float | None = None
    sampling: Sampling = field(default_factory=lambda: sampling_with(1.0))
    assumptions: Assumptions = field(default_factory=Assumptions)


@dataclass(frozen=True)
class PlanCandidate:
    """A plan that determines what is asked.

    Attributes:
        scheme: its set of lines.
        plan: the plan.
        duration: of it.
        expectation: standard uncertainties.
        uncertainty: expanded (95 %) of the purpose's target, the worst of what counts, m or rad.
        determined: names of what counts and is determined.
    """

    scheme: Scheme
    plan: Plan
    duration: PlanDuration
    expectation: PlanExpectation
    uncertainty: float
    determined: tuple[str, ...]


@dataclass(frozen=True)
class PlanProposal:
    """The result of the search.

    Attributes:
        request: what was asked.
        chosen: the plan that is proposed.
        reason: why this one, in a sentence.
        front: candidates by duration, each better by a tenth than all that are quicker.
        considered: number of candidates that determine what is asked.
        discarded: sets of lines that do not, and why, in words.
    """

    request: Request
    chosen: PlanCandidate
    reason: str
    front: tuple[PlanCandidate, ...]
    considered: int
    discarded: tuple[str, ...]


def propose(request: Request) -> PlanProposal:
    """Seek the plan for a request.

    The expected uncertainty of every candidate is computed from its design matrix. Wished for an
    uncertainty, the shortest plan that reaches it is taken; given a time, the best within it; with
    neither, the shortest whose uncertainty is at most twice that of the best.

    Raises:
        ValueError: the request contradicts itself or the machine, or no candidate fulfils it; says
            what the nearest one gives.
    """
    purpose = _purpose(request)
    discarded: dict[str, str] = {}
    found = list(_candidates(request, purpose, discarded))
    if not found:
        raise Refusal(
            "no plan was found: "
            + "; ".join(f"{words}: {why}" for words, why in discarded.items()),
            fault="not_found",
        )
    most = max(len(candidate.determined) for candidate in found)
    fit = [candidate for candidate in found if len(candidate.determined) == most]
    for candidate in found:
        if len(candidate.determined) < most:
            seen = ", ".join(candidate.determined) or "nothing of it"
            discarded.setdefault(candidate.scheme.words, f"determines only {seen}")
    chosen, reason = _choose(fit, request, purpose)
    return PlanProposal(
        request=request,
        chosen=chosen,
        reason=reason,
        front=_front(fit),
        considered=len(fit),
        discarded=tuple(f"{words}: {why}" for words, why in discarded.items()),
    )


def _purpose(request: Request) -> PlanPurpose:
    if request.purpose not in PURPOSES:
        raise Refusal(
            f"'{request.purpose}' is not a purpose; use one of {', '.join(PURPOSES)}",
            fault="unknown",
        )
    purpose = PURPOSES[request.purpose]
    if purpose.rotations and not request.machine.chain:
        raise Refusal(
            "angular errors need the kinematic chain: the order of the axes from workpiece to "
            "tool, for example YXZ",
            fault="missing",
        )
    return purpose


def _candidates(
    request: Request, purpose: PlanPurpose, discarded: dict[str, str]
) -> Iterator[PlanCandidate]:
    """Make every plan; what a set of lines lacks goes into ``discarded``."""
    overrun = _overrun(request, purpose)
    if overrun > request.margin:
        raise Refusal(
            f"an overrun of {overrun:g} m does not fit into the margin of "
            f"{request.margin:g} m at the ends of the travel",
            fault="out_of_range",
            aspect="overrun",
        )
    low, high = travel_box(request.machine, request.margin, request.low, request.high)
    directions = request.directions or purpose.directions
    repeats = purpose.repeats if request.repeats is None else (request.repeats,)
    chain = request.machine.chain if purpose.rotations else ""
    for scheme in purpose.schemes:
        volumes = list(_volumes(request, purpose, scheme, low, high))
        if not volumes:
            discarded[scheme.words] = f"needs more than {BLOCKS[-1]} blocks for this spacing"
        for volume in volumes:
            single = _plan(request, scheme, volume, 1, directions[:1])
            base = expect(single, request.stop_uncertainty, chain)
            uncertainties = purpose.uncertainties(base)
            known = tuple(name for name, u in uncertainties.items() if math.isfinite(u))
            missing = [name for name in uncertainties if name not in known]
            if purpose.needed and missing:
                discarded[scheme.words] = f"does not determine {', '.join(missing)}"
                break
            once = _plan(request, scheme, volume, 1, directions)
            beyond = beyond_machine(once, request.machine)
            if beyond:
                raise ValueError(f"the plan does not fit this machine: {beyond}")
            for count in repeats:
                plan = _plan(request, scheme, volume, count, directions)
                # Passes of all lines alike add nothing but weight.
                expectation = base.scaled(1.0 / math.sqrt(count * len(directions)))
                yield PlanCandidate(
                    scheme=scheme,
                    plan=plan,
                    duration=duration(plan, request.machine, request.assumptions),
                    expectation=expectation,
                    uncertainty=target_uncertainty(purpose, expectation, known),
                    determined=known,
                )


def _volumes(
    request: Request, purpose: PlanPurpose, scheme: Scheme, low: Point, high: Point
) -> Iterator[Volume]:
    """Return the volumes with the fewest blocks that keep to the spacing between targets."""
    if request.blocks is not None:
        yield volume_in(low, high, request.blocks)
        return
    longest = max(b - a for a, b in zip(low, high, strict=True))
    spacing = request.spacing
    if spacing is None:
        spacing = min(purpose.spacing * longest, purpose.spacing_m)
    by_standard = math.isfinite(purpose.spacing_m)
    found = 0
    for blocks in BLOCKS:
        if by_standard and blocks < _LEAST_BLOCKS_OF_STANDARDS:
            continue
        volume = volume_in(low, high, blocks)
        if target_spacing(scheme, volume) <= spacing * _SAME and found < _VOLUMES_TRIED:
            found += 1
            yield volume


def _plan(
    request: Request, scheme: Scheme, volume: Volume, repeats: int, directions: tuple[str, ...]
) -> Plan:
    sides = " x ".join(f"{step * volume.blocks * 1e3:g}" for step in volume.step)
    return Plan(
        name=f"{request.purpose}: {scheme.words}, {sides} mm",
        volume=volume,
        lines=lines_of(scheme, volume, repeats, directions),
        feed=min(request.feed, request.machine.feed_limit_m_per_s),
        sampling=request.sampling,
        pause_for_setup=True,
        one_alignment_per_diagonal=scheme.one_alignment,
        overrun=_overrun(request, PURPOSES[request.purpose]),
    )


def _overrun(request: Request, purpose: PlanPurpose) -> float:
    """Return the overrun that is wished, or the usual one of the purpose, m."""
    if request.overrun is not None:
        return request.overrun
    return _OVERRUN if purpose.overrun else 0.0


def target_uncertainty(
    purpose: PlanPurpose, expectation: PlanExpectation, known: tuple[str, ...]
) -> float:
    """Return the expanded uncertainty that counts; that of the volume, where the box is asked.

    Args:
        purpose: of the plan.
        expectation: standard uncertainties.
        known: names of what counts and is determined.
    """
    uncertainties = purpose.uncertainties(expectation)
    if VOLUMETRIC in uncertainties:
        return COVERAGE_FACTOR * uncertainties[VOLUMETRIC]
    return COVERAGE_FACTOR * worst(uncertainties[name] for name in known)


def _choose(
    fit: list[PlanCandidate], request: Request, purpose: PlanPurpose
) -> tuple[PlanCandidate, str]:
    """Return the candidate that fits the wishes best, and why it does."""
    best = min(fit, key=lambda one: (one.uncertainty, one.duration.total))
    quickest = min(fit, key=lambda one: (one.duration.total, one.uncertainty))
    in_time = fit
    if request.time_limit is not None:
        limit = request.time_limit * _SAME
        in_time = [one for one in fit if one.duration.total <= limit]
        if not in_time:
            raise Refusal(
                f"no plan for {request.purpose} takes less than {hours(request.time_limit)}; the "
                f"quickest, {quickest.scheme.words}, takes {hours(quickest.duration.total)} with "
                f"an expected uncertainty of {size_words(quickest.uncertainty, purpose.unit)}",
                fault="not_found",
            )
    best_in_time = min(in_time, key=lambda one: (one.uncertainty, one.duration.total))
    within = f" within {hours(request.time_limit)}" if request.time_limit is not None else ""
    if request.uncertainty is not None:
        good = [one for one in in_time if one.uncertainty <= request.uncertainty * _SAME]
        if not good:
            raise Refusal(
                f"no plan for {request.purpose}{within} reaches "
                f"{size_words(request.uncertainty, purpose.unit)}; the best, "
                f"{best_in_time.scheme.words} in {hours(best_in_time.duration.total)}, is expected "
                f"to reach {size_words(best_in_time.uncertainty, purpose.unit)}",
                fault="not_found",
            )
        wished = size_words(request.uncertainty, purpose.unit)
        return (
            min(good, key=lambda one: (one.duration.total, one.uncertainty)),
            f"the shortest of {len(fit)} candidates that is expected to reach {wished}{within}",
        )
    if request.time_limit is not None:
        return best_in_time, f"the best of {len(in_time)} candidates{within}"
    enough = [one for one in fit if one.uncertainty <= _ENOUGH * best.uncertainty]
    return (
        min(enough, key=lambda one: (one.duration.total, one.uncertainty)),
        f"the shortest of {len(fit)} candidates whose expected uncertainty is at most "
        f"{_ENOUGH:g} times that of the best ({size_words(best.uncertainty, purpose.unit)} in "
        f"{hours(best.duration.total)})",
    )


def _front(fit: list[PlanCandidate]) -> tuple[PlanCandidate, ...]:
    """Return the candidates by duration, each clearly better than all that are quicker."""
    front: list[PlanCandidate] = []
    for one in sorted(fit, key=lambda one: (one.duration.total, one.uncertainty)):
        if not front or one.uncertainty < _CLEARLY * front[-1].uncertainty:
            front.append(one)
    return tuple(front)


def hours(seconds: float) -> str:
    """Say how long something takes, for example ``1 h 05 min``."""
    minutes = max(1, math.ceil(seconds / 60.0 - 1e-9))
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"


def size_words(value: float, unit: str) -> str:
    """Write a length in µm or an angle in µm/m to two digits."""
    return f"{value * 1e6:.2g} {'µm' if unit == 'm' else 'µm/m'}"
