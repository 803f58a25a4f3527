"""Seeks plans by exchange: lines, repeats, blocks, dwell, feed, and whether they are on the fly."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from stepdiag_ros.metrology.plan import (
    DIAGONAL,
    FEWEST_MOVES,
    ON_THE_FLY,
    STEP_DIAGONAL,
    Line,
    Plan,
    Sampling,
    Volume,
)
from stepdiag_ros.metrology.plausible import Plausible
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.planning.candidates import (
    BLOCKS,
    PlanPurpose,
    target_spacing,
    travel_box,
    volume_in,
)
from stepdiag_ros.planning.duration import MoveTimes, duration
from stepdiag_ros.planning.exchange import Choice, Exchange, pareto
from stepdiag_ros.planning.information import Information
from stepdiag_ros.planning.offers import (
    Offer,
    lines_in,
    offers_of,
    words_of,
)
from stepdiag_ros.planning.order import Order
from stepdiag_ros.planning.request import PlanCandidate, Request, sampling_with
from stepdiag_ros.run.feasibility import beyond_machine

_DWELLS = (0.4, 0.7, 1.0, 2.0)
"""s: those that are tried."""
_CALM = 0.25
"""Share of a dwell in which the machine calms down, as in the demo plan."""
_FEEDS = (0.033, 0.1)
"""m/s: those that are tried. Faster moves of a step are all acceleration, and warm the machine."""
_FEEDS_ON_THE_FLY = (0.01, 0.02, 0.033, 0.05, 0.1)
"""m/s: slower moves have more readings, faster ones take less time."""
_ENDS = Sampling(dwell=0.4, settle=0.1, window=0.3, longest_wait=3.0)
"""Of the first and the last stop of a line on the fly."""
_CLEARLY = 0.95
"""Share of the uncertainty of a quicker plan that makes a slower one worth to be shown."""
_SAME = 1.001


@dataclass(frozen=True)
class Space:
    """All lines that may be measured over one box, under one dwell and feed.

    Attributes:
        conditions: plan without lines.
        exchange: search over its offers.
    """

    conditions: Plan
    exchange: Exchange


class Search:
    """The search for the plans of a request.

    Args:
        request: what is asked.
        purpose: of it.

    Attributes:
        front: choices by time, each clearly better than all that are quicker, with their spaces.
        considered: number of choices that were looked at.
        discarded: what keeps to no spacing, in words.
    """

    def __init__(self, request: Request, purpose: PlanPurpose) -> None:
        self._request, self._purpose = request, purpose
        wished = request.until or dict.fromkeys(purpose.figures, COVERAGE_FACTOR)
        self._limits = {name: limit / COVERAGE_FACTOR for name, limit in wished.items()}
        self._names = tuple(dict.fromkeys((*purpose.needed, *self._limits)))
        self._figures = tuple(request.until) if len(request.until) == 1 else purpose.figures
        found: list[tuple[Space, Choice]] = []
        self.considered = 0
        self.discarded: dict[str, str] = {}
        for volume, lines in self._volumes():
            for conditions in self._ways(volume):
                space = self._space(lines, conditions)
                self._refuse_beyond(space)
                found += [(space, choice) for choice in space.exchange.frontier()]
                self.considered += space.exchange.looked_at
        best = {id(choice) for choice in pareto(choice for _, choice in found)}
        self._found = sorted(
            (one for one in found if id(one[1]) in best), key=lambda one: one[1].seconds
        )
        self.front: list[tuple[Space, Choice]] = []
        for one in self._found:
            if not self.front or one[1].ratio < _CLEARLY * self.front[-1][1].ratio:
                self.front.append(one)

    def shortest(self) -> tuple[Space, Choice] | None:
        """Return the shortest choice within the wishes that exchanges find; None without one."""
        good = [one for one in self._found if one[1].ratio <= _SAME]
        if not good:
            return None
        starts = self._otherwise(good[0], lambda choice: choice.ratio <= 1.0)
        found = [(space, space.exchange.shortest(choice)) for space, choice in starts]
        return min(found, key=lambda one: one[1].seconds)

    def best_within(self, seconds: float) -> tuple[Space, Choice] | None:
        """Return the best choice within a time that exchanges find; None if nothing is as short."""
        quick = [one for one in self._found if one[1].seconds <= seconds * _SAME]
        if not quick:
            return None
        starts = self._otherwise(quick[-1], lambda choice: choice.seconds <= seconds)
        found = [(space, space.exchange.best_within(choice, seconds)) for space, choice in starts]
        return min(found, key=lambda one: one[1].ratio)

    def _otherwise(
        self, start: tuple[Space, Choice], keeps: Callable[[Choice], bool]
    ) -> Iterator[tuple[Space, Choice]]:
        """Go over the same lines with other dwells and feeds that keep to a wish."""
        space, choice = start
        yield space, choice
        now = space.conditions
        if now.on_the_fly:
            others = [replace(now, feed=feed) for feed in self._feeds_on_the_fly(now.volume)]
        elif self._request.reading_noise:
            others = [replace(now, sampling=sampling) for sampling in self._samplings()]
        else:
            return
        lines = tuple(offer.line for offer in space.exchange.information.offers)
        for conditions in others:
            if conditions != now:
                other = self._space(lines, conditions)
                again = other.exchange.choice(choice.counts)
                if keeps(again):
                    yield other, again

    def candidate(self, space: Space, choice: Choice, final: bool = False) -> PlanCandidate:
        """Return the plan of a choice.

        Args:
            space: in which it was found.
            choice: lines and repeats.
            final: seek the best order of the lines.
        """
        request, exchange = self._request, space.exchange
        volume = space.conditions.volume
        order = Order(exchange, choice, volume, request.machine, request.pauses)
        ordered = order.best() if final else order.by_need()
        words = words_of(ordered.lines)
        if space.conditions.on_the_fly:
            words += ", on the fly"
        plan = replace(
            space.conditions,
            lines=ordered.lines,
            name=f"{request.purpose}: {words}, {_sides(volume)} mm",
        )
        standing = exchange.information.standing(np.array(choice.counts))
        told = standing.largest()
        figure = max(self._figures, key=lambda name: told[name])
        worst = max(self._limits, key=lambda name: told[name] / self._limits[name])
        rows = [row for row, name in enumerate(standing.quantities.names) if name in self._figures]
        return PlanCandidate(
            words=words,
            plan=plan,
            duration=duration(plan, request.machine, request.assumptions),
            uncertainty=COVERAGE_FACTOR * told[figure],
            determined=self._purpose.needed,
            ratio=request.ratio(told),
            limited=f"{worst} by {exchange.information.limit(np.array(choice.counts), worst)}",
            drift=COVERAGE_FACTOR * float(np.max(ordered.drift[rows])),
        )

    def _volumes(self) -> Iterator[tuple[Volume, tuple[Line, ...]]]:
        """Return the boxes with the fewest blocks that keep to the spacing between targets.

        Direct diagonals have longer steps than the axes: with them a box of its own is tried.
        """
        request, purpose = self._request, self._purpose
        low, high = travel_box(request.machine, request.margin, request.low, request.high)
        if request.blocks is not None:
            volume = volume_in(low, high, request.blocks)
            yield volume, lines_in(volume, purpose.kinds)
            return
        longest = max(b - a for a, b in zip(low, high, strict=True))
        spacing = request.spacing or purpose.spacing * longest
        along_axes = tuple(kind for kind in purpose.kinds if kind != DIAGONAL)
        for kinds in dict.fromkeys((along_axes, purpose.kinds)):
            for blocks in BLOCKS:
                volume = volume_in(low, high, blocks)
                lines = lines_in(volume, kinds)
                if target_spacing(lines, volume) <= spacing * _SAME:
                    yield volume, lines
                    break
            else:
                self.discarded[", ".join(kinds)] = (
                    f"needs more than {BLOCKS[-1]} blocks for this spacing"
                )

    def _samplings(self) -> list[Sampling]:
        told = self._request.sampling
        if told is not None:
            return [told]
        return [
            replace(sampling_with(dwell), settle=_CALM * dwell, window=(1.0 - _CALM) * dwell)
            for dwell in _DWELLS
        ]

    def _feed(self) -> float:
        """Return the feed that is wished, or the fastest that is tried: it costs nothing here."""
        limit = self._request.machine.feed_limit_m_per_s
        return min(self._request.feed or max(_FEEDS), limit)

    def _ways(self, volume: Volume) -> Iterator[Plan]:
        """Go over the ways of measuring a box: plans without lines."""
        request = self._request
        at_stops = Plan(
            name=request.purpose,
            volume=volume,
            lines=(),
            feed=self._feed(),
            sampling=self._quickest(volume),
            pause_for_setup=request.pauses,
            one_alignment_per_diagonal=True,
            overrun=request.overrun_or_usual,
        )
        yield at_stops
        feeds = self._feeds_on_the_fly(volume)
        if feeds:
            moving = replace(at_stops, measurement=ON_THE_FLY, sampling=_ENDS)
            yield replace(moving, feed=min(feeds, key=lambda feed: self._price(moving, feed)))

    def _feeds_on_the_fly(self, volume: Volume) -> list[float]:
        """Return the feeds at which every move has a part at constant feed, m/s."""
        request, machine = self._request, self._request.machine
        if request.streams is None or volume.blocks < FEWEST_MOVES:
            return []
        fastest = np.sqrt(0.5 * machine.acceleration_m_per_s2 * min(volume.step))
        limit = min(machine.feed_limit_m_per_s, float(fastest))
        wished = _FEEDS_ON_THE_FLY if request.feed is None else (request.feed,)
        return [feed for feed in wished if feed <= limit]

    def _price(self, conditions: Plan, feed: float) -> float:
        """Return seconds times variance of a step diagonal on the fly, at a feed, m² s."""
        line = lines_in(conditions.volume, (STEP_DIAGONAL,))[:1]
        (offer,) = self._offers(line, replace(conditions, feed=feed))
        return offer.seconds * float(np.mean(np.diagonal(offer.covariance)))

    def _offers(self, lines: tuple[Line, ...], conditions: Plan) -> tuple[Offer, ...]:
        request = self._request
        return offers_of(
            lines,
            conditions,
            request.machine,
            request.noise_of(conditions),
            request.directions or self._purpose.directions,
            request.assumptions,
            request.repeats or 1,
        )

    def _space(self, lines: tuple[Line, ...], conditions: Plan) -> Space:
        request, machine = self._request, self._request.machine
        information = Information(
            self._offers(lines, conditions),
            conditions.volume,
            machine.chain,
            Plausible(machine.rotations),
            self._names,
        )
        most = request.most_repeats // (request.repeats or 1)
        return Space(conditions, Exchange(information, self._limits, most))

    def _quickest(self, volume: Volume) -> Sampling:
        """Return the sampling whose stops contribute most in a second."""
        request = self._request
        clock = MoveTimes(request.machine, self._feed(), request.assumptions.settling_s)
        move = clock.move(float(np.mean(volume.step)))

        def price(sampling: Sampling) -> float:
            return request.noise.of(sampling.window) ** 2 * (move + sampling.dwell)

        return min(self._samplings(), key=price)

    def _refuse_beyond(self, space: Space) -> None:
        lines = tuple(offer.line for offer in space.exchange.information.offers)
        beyond = beyond_machine(replace(space.conditions, lines=lines), self._request.machine)
        if beyond:
            raise ValueError(f"the plan does not fit this machine: {beyond}")


def _sides(volume: Volume) -> str:
    return " x ".join(f"{step * volume.blocks * 1e3:g}" for step in volume.step)
