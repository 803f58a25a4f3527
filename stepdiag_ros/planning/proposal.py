"""Seeks a plan: of all that determine what is asked, the one that fits best.

Lines are sought by exchange (``search``); where a standard prescribes them, or all rotations are
free, the sets of lines of the purpose are tried.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from stepdiag_ros.metrology.geometry import ROTATIONS, SQUARENESS
from stepdiag_ros.metrology.plan import FORWARD, Plan, Volume
from stepdiag_ros.metrology.refusal import Findings, Refusal
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.planning.assumed_rotations import AssumedRotations, assumed_rotations
from stepdiag_ros.planning.candidates import (
    BLOCKS,
    PURPOSES,
    PlanPurpose,
    Scheme,
    lines_of,
    of_expectation,
    target_spacing,
    travel_box,
    volume_in,
)
from stepdiag_ros.planning.duration import duration
from stepdiag_ros.planning.expectation import expect, expect_with_rotations, worst
from stepdiag_ros.planning.moves import Point
from stepdiag_ros.planning.request import PlanCandidate, Request, purpose_of, sampling_with
from stepdiag_ros.planning.search import Search
from stepdiag_ros.run.feasibility import beyond_machine

_ENOUGH = 1.25
"""Without a wish, a plan is good enough whose uncertainty is within this factor of the best."""
_CLEARLY = 0.9
_SAME = 1.001
_VOLUMES_TRIED = 3
"""Numbers of blocks tried for a set of lines, from the fewest that keep to the spacing."""
_LEAST_BLOCKS_OF_STANDARDS = 4
"""Five targets at least (ISO 230-2:2014, 4.3.2)."""
_TRIES = 4
"""To keep to a time; the search does not count the ways from line to line."""
_NEARLY = 1.02
_FEED = 0.033
"""Of plans that a standard prescribes, m/s."""
_DWELL = 1.0
"""Of these, s."""


@dataclass(frozen=True)
class PlanProposal:
    """The result of the search.

    Attributes:
        request: what was asked.
        chosen: the plan that is proposed.
        reason: why this one, in a sentence.
        front: candidates by duration, each clearly better than all that are quicker.
        considered: number of candidates that were looked at.
        discarded: sets of lines that do not determine what is asked, and why, in words.
    """

    request: Request
    chosen: PlanCandidate
    reason: str
    front: tuple[PlanCandidate, ...]
    considered: int
    discarded: tuple[str, ...]

    @cached_property
    def assumed(self) -> AssumedRotations | None:
        """Return the size of rotations without which the wish is not reached; None if it is."""
        return assumed_rotations(self.request, self.chosen)

    @property
    def figure(self) -> str:
        """Return the quantity whose uncertainty counts, in words."""
        purpose, wished = PURPOSES[self.request.purpose], tuple(self.request.until)
        alone = len(wished) == 1 and wished[0] in purpose.needed[:-1]
        return wished[0] if alone else purpose.target


def check_request(request: Request) -> PlanPurpose:
    """Return the purpose of a request that does not contradict itself.

    Raises:
        ValueError: it does, or the purpose is not possible; a sentence for each contradiction.
    """
    findings = Findings()
    purpose = findings.of(lambda: purpose_of(request), None)
    if request.purpose in PURPOSES:
        findings.of(lambda: _check_overrun(request), None)
        findings.of(lambda: _check_streams(request), None)
    findings.of(
        lambda: travel_box(request.machine, request.margin, request.low, request.high), None
    )
    findings.refuse()
    assert purpose is not None
    return purpose


def _check_streams(request: Request) -> None:
    if request.streams is not None and not PURPOSES[request.purpose].kinds:
        sought = ", ".join(name for name, purpose in PURPOSES.items() if purpose.kinds)
        raise Refusal(
            f"lines on the fly are not sought for {request.purpose}, but for {sought}; in the plan"
            " that is written, 'measurement: on_the_fly' asks for them",
            fault="unsupported",
            about="on_the_fly",
        )


def _check_overrun(request: Request) -> None:
    overrun = request.overrun_or_usual
    if overrun > request.margin:
        raise Refusal(
            f"an overrun of {overrun:g} m does not fit into the margin of "
            f"{request.margin:g} m at the ends of the travel",
            fault="out_of_range",
            aspect="overrun",
        )


def propose(request: Request) -> PlanProposal:
    """Seek the plan for a request.

    Wished for an uncertainty, the shortest plan that is expected to reach it is taken; given a
    time, the shortest within it that is as good as the best; with neither, the shortest that is
    nearly as good.

    Raises:
        ValueError: the request contradicts itself or the machine, or no candidate fulfils it; says
            what the nearest one gives, and what limits it.
    """
    purpose = check_request(request)
    return _by_exchange(request, purpose) if purpose.kinds else _prescribed(request, purpose)


def _by_exchange(request: Request, purpose: PlanPurpose) -> PlanProposal:
    search = Search(request, purpose)
    if not search.front:
        raise _not_found(search.discarded, "no lines determine it")
    front = [search.candidate(*one) for one in search.front]
    fit = list(front)
    if request.until and (found := search.shortest()):
        fit.append(search.candidate(*found, final=True))
    elif not request.until and request.time_limit is not None:
        fit += _within(search, request.time_limit)
    chosen, reason = _choose(fit, request, purpose, search.considered)
    if chosen in front:
        number = front.index(chosen)
        chosen = front[number] = search.candidate(*search.front[number], final=True)
    return PlanProposal(
        request=request,
        chosen=chosen,
        reason=reason,
        # The search does not count the ways from line to line, which may turn round two plans.
        front=_front([*front, chosen]),
        considered=search.considered,
        discarded=tuple(f"{words}: {why}" for words, why in search.discarded.items()),
    )


def _within(search: Search, limit: float) -> list[PlanCandidate]:
    """Return the best plan within a time, ways from line to line included; none if none is."""
    asked = limit
    for _ in range(_TRIES):
        found = search.best_within(asked)
        if found is None:
            break
        made = search.candidate(*found, final=True)
        if made.duration.total <= limit:
            return [made]
        asked *= limit / made.duration.total
    return []


def _prescribed(request: Request, purpose: PlanPurpose) -> PlanProposal:
    discarded: dict[str, str] = {}
    found = list(_candidates(request, purpose, discarded))
    if not found:
        raise _not_found(discarded, "no set of lines")
    most = max(len(candidate.determined) for candidate in found)
    fit = [candidate for candidate in found if len(candidate.determined) == most]
    for candidate in found:
        if len(candidate.determined) < most:
            seen = ", ".join(candidate.determined) or "nothing of it"
            discarded.setdefault(candidate.words, f"determines only {seen}")
    chosen, reason = _choose(fit, request, purpose, len(fit))
    return PlanProposal(
        request=request,
        chosen=chosen,
        reason=reason,
        front=_front(fit),
        considered=len(fit),
        discarded=tuple(f"{words}: {why}" for words, why in discarded.items()),
    )


def _not_found(discarded: dict[str, str], otherwise: str) -> Refusal:
    told = "; ".join(f"{words}: {why}" for words, why in discarded.items())
    return Refusal(f"no plan was found: {told or otherwise}", fault="not_found")


def _candidates(
    request: Request, purpose: PlanPurpose, discarded: dict[str, str]
) -> Iterator[PlanCandidate]:
    """Make every plan; what a set of lines lacks goes into ``discarded``."""
    low, high = travel_box(request.machine, request.margin, request.low, request.high)
    repeats = purpose.repeats if request.repeats is None else (request.repeats,)
    for scheme in purpose.schemes:
        volumes = list(_volumes(request, purpose, scheme, low, high))
        if not volumes:
            discarded[scheme.words] = f"needs more than {BLOCKS[-1]} blocks for this spacing"
        for volume in volumes:
            plans = {count: _plan(request, scheme, volume, count) for count in repeats}
            beyond = beyond_machine(plans[repeats[0]], request.machine)
            if beyond:
                raise ValueError(f"the plan does not fit this machine: {beyond}")
            once = _told(request, purpose, _plan(request, scheme, volume, 1), repeats)
            for count, told in once.items():
                made = _candidate(request, scheme, plans[count], told)
                missing = [name for name in purpose.needed if name not in made.determined]
                if missing:
                    discarded[scheme.words] = f"does not determine {', '.join(missing)}"
                    break
                yield made


def _told(
    request: Request, purpose: PlanPurpose, once: Plan, repeats: Iterable[int]
) -> dict[int, dict[str, float]]:
    """Return the expected standard uncertainties with each number of repeats of all lines."""
    machine, noise = request.machine, request.noise.of(once.sampling.window)
    if purpose.rotations:
        base = expect(once, noise, machine.chain)
        every = {count: base.scaled(1.0 / math.sqrt(count)) for count in repeats}
    else:
        every = {
            count: expect_with_rotations(
                once, noise / math.sqrt(count), machine.chain, machine.rotations
            )
            for count in repeats
        }
    return {count: of_expectation(one, purpose.figures) for count, one in every.items()}


def _candidate(
    request: Request, scheme: Scheme, plan: Plan, told: Mapping[str, float]
) -> PlanCandidate:
    known = tuple(name for name, u in told.items() if math.isfinite(u))
    wished = {name: u if name in known else 0.0 for name, u in told.items()}
    return PlanCandidate(
        words=scheme.words,
        plan=plan,
        duration=duration(plan, request.machine, request.assumptions),
        uncertainty=COVERAGE_FACTOR * worst(told[name] for name in known),
        determined=known,
        ratio=request.ratio(wished),
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
        if (
            target_spacing(lines_of(scheme, volume, 1, (FORWARD,)), volume) <= spacing * _SAME
            and found < _VOLUMES_TRIED
        ):
            found += 1
            yield volume


def _plan(request: Request, scheme: Scheme, volume: Volume, repeats: int) -> Plan:
    directions = request.directions or PURPOSES[request.purpose].directions
    sides = " x ".join(f"{step * volume.blocks * 1e3:g}" for step in volume.step)
    return Plan(
        name=f"{request.purpose}: {scheme.words}, {sides} mm",
        volume=volume,
        lines=lines_of(scheme, volume, repeats, directions),
        feed=min(request.feed or _FEED, request.machine.feed_limit_m_per_s),
        sampling=request.sampling or sampling_with(_DWELL),
        pause_for_setup=request.pauses,
        one_alignment_per_diagonal=scheme.one_alignment,
        overrun=request.overrun_or_usual,
    )


def _choose(
    fit: list[PlanCandidate], request: Request, purpose: PlanPurpose, considered: int
) -> tuple[PlanCandidate, str]:
    """Return the candidate that fits the wishes best, and why it does."""
    best = min(fit, key=lambda one: (one.uncertainty, one.duration.total))
    in_time = _in_time(fit, request, purpose)
    best_in_time = _as_good(in_time)
    within = f" within {hours(request.time_limit)}" if request.time_limit is not None else ""
    if request.until:
        wished = wish_words(request, purpose)
        good = [one for one in in_time if one.ratio <= _SAME]
        if not good:
            least = min(one.ratio for one in in_time)
            nearest = [one for one in in_time if one.ratio <= _NEARLY * least]
            best_in_time = min(nearest, key=lambda one: one.duration.total)
            why = f", limited in {best_in_time.limited}" if best_in_time.limited else ""
            raise Refusal(
                f"no plan for {request.purpose}{within} reaches {wished}; the best, "
                f"{best_in_time.words} in {hours(best_in_time.duration.total)}, is expected "
                f"to reach {size_words(best_in_time.uncertainty, purpose.unit)}{why}",
                fault="not_found",
            )
        return (
            min(good, key=lambda one: (one.duration.total, one.uncertainty)),
            f"the shortest of {considered} candidates that is expected to reach {wished}{within}",
        )
    if request.time_limit is not None:
        why = f"the shortest of {considered} candidates{within} that are as good as the best"
        return best_in_time, why
    enough = [one for one in fit if one.uncertainty <= _ENOUGH * best.uncertainty]
    return (
        min(enough, key=lambda one: (one.duration.total, one.uncertainty)),
        f"the shortest of {considered} candidates whose expected uncertainty is at most "
        f"{_ENOUGH:g} times that of the best ({size_words(best.uncertainty, purpose.unit)} in "
        f"{hours(best.duration.total)})",
    )


def _as_good(fit: list[PlanCandidate]) -> PlanCandidate:
    """Return the shortest candidate whose uncertainty is practically that of the best."""
    least = min(one.uncertainty for one in fit)
    good = [one for one in fit if one.uncertainty <= _NEARLY * least]
    return min(good, key=lambda one: (one.duration.total, one.uncertainty))


def _in_time(
    fit: list[PlanCandidate], request: Request, purpose: PlanPurpose
) -> list[PlanCandidate]:
    """Return the candidates that keep to the time limit."""
    if request.time_limit is None:
        return fit
    in_time = [one for one in fit if one.duration.total <= request.time_limit * _SAME]
    if not in_time:
        quickest = min(fit, key=lambda one: (one.duration.total, one.uncertainty))
        aligning = quickest.duration.alignment
        told = f", {hours(aligning)} of it to align laser and mirror," if aligning else ""
        raise Refusal(
            f"no plan for {request.purpose} takes less than {hours(request.time_limit)}; the "
            f"quickest, {quickest.words}, takes {hours(quickest.duration.total)}{told} with "
            f"an expected uncertainty of {size_words(quickest.uncertainty, purpose.unit)}"
            f"{_what_takes_time(request)}",
            fault="not_found",
        )
    return in_time


def _what_takes_time(request: Request) -> str:
    """Name the wishes that can be given up to save time."""
    wishes = {"repeats": request.repeats, "blocks": request.blocks, "feed": request.feed}
    asked = [f"--{name}" for name, value in wishes.items() if value is not None]
    asked += ["--align-linear", "--align-diagonal"] if request.pauses else []
    return f"; what may be shortened: {', '.join(asked)}" if asked else ""


def wish_words(request: Request, purpose: PlanPurpose) -> str:
    """Say which uncertainty is wished."""
    sizes = {
        name: size_words(limit, "rad" if name in (*ROTATIONS, *SQUARENESS) else "m")
        for name, limit in request.until.items()
    }
    if set(sizes) == set(purpose.figures):
        return next(iter(sizes.values()))
    return ", ".join(f"{size} of {name}" for name, size in sizes.items())


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
