"""What a plan is asked for, and what a search for it finds."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from stepdiag_ros.metrology.geometry import ROTATIONS
from stepdiag_ros.metrology.machine import Machine
from stepdiag_ros.metrology.on_the_fly.expected import Streams
from stepdiag_ros.metrology.plan import Plan, Sampling
from stepdiag_ros.metrology.refusal import Refusal
from stepdiag_ros.metrology.target import Target
from stepdiag_ros.metrology.uncertainty.coverage import COVERAGE_FACTOR
from stepdiag_ros.planning.candidates import PURPOSES, PlanPurpose
from stepdiag_ros.planning.duration import Assumptions, PlanDuration
from stepdiag_ros.planning.expectation import Noise
from stepdiag_ros.planning.offers import StopNoise, noise_of_stops

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
        # To a nanosecond: a plan file has no digits of rounding.
        window=round(dwell - settle - (_FREE_BY_HAND * dwell if by_hand else 0.0), 9),
        longest_wait=max(standard.longest_wait, 3.0 * dwell),
    )


@dataclass(frozen=True)
class Request:
    """What is asked for.

    Attributes:
        purpose: a key of ``candidates.PURPOSES``.
        machine: its travel, chain, drives and drift; a chain is needed for angular errors only.
        stop_uncertainty: standard uncertainty of a single stop that a longer dwell does not
            improve, m.
        reading_noise: standard uncertainty of the mean of one second of readings, m √s.
        until: wanted expanded uncertainty (95 %) of quantities, m or rad by name: those of
            ``PlanPurpose.figures``, curves, squareness errors; empty for no wish.
        time_limit: longest duration, alignments included, s; None for no limit.
        feed: of the moves, m/s; sought if None.
        margin: kept free at every end of the travel, m.
        low: first corner of the box, m; that of the travel if None.
        high: last corner of the box, m.
        blocks: number of blocks; sought if None.
        spacing: largest distance between targets, m; the purpose's own if None.
        repeats: of every line; sought if None.
        directions: of every line; the purpose's own if None.
        overrun: with which lines begin, m; None: 2 mm for the purposes of a standard, else none.
        sampling: of the stops; sought if None.
        streams: of laser and controller, where lines may be measured on the fly; else None.
        assumptions: for the duration. Where no alignment takes time, none is waited for.
    """

    purpose: str
    machine: Machine
    stop_uncertainty: float = 0.1e-6
    reading_noise: float = 0.0
    until: Mapping[str, float] = field(default_factory=dict)
    time_limit: float | None = None
    feed: float | None = None
    margin: float = 0.005
    low: tuple[float, float, float] | None = None
    high: tuple[float, float, float] | None = None
    blocks: int | None = None
    spacing: float | None = None
    repeats: int | None = None
    directions: tuple[str, ...] | None = None
    overrun: float | None = None
    sampling: Sampling | None = None
    streams: Streams | None = None
    assumptions: Assumptions = field(default_factory=Assumptions)

    @property
    def noise(self) -> StopNoise:
        """Return how uncertain a stop is."""
        return StopNoise(self.stop_uncertainty, self.reading_noise)

    def noise_of(self, plan: Plan) -> Noise:
        """Return how uncertain the stops of a plan are, or its nodes on the fly."""
        return noise_of_stops(plan, self.machine, self.noise, self.streams, self.assumptions)

    @property
    def overrun_or_usual(self) -> float:
        """Return the overrun that is wished, or the usual one of the purpose, m."""
        if self.overrun is not None:
            return self.overrun
        return _OVERRUN if PURPOSES[self.purpose].overrun else 0.0

    @property
    def pauses(self) -> bool:
        """Say whether the plan waits for alignments: they take time."""
        told = self.assumptions
        return told.linear_alignment_s > 0.0 or told.diagonal_alignment_s > 0.0

    @property
    def most_repeats(self) -> int:
        """Return how often a line may be measured at most."""
        return max(PURPOSES[self.purpose].repeats) if self.repeats is None else self.repeats

    def ratio(self, uncertainties: Mapping[str, float]) -> float:
        """Return how far standard uncertainties are above the wishes; at most 1: within them."""
        return max(
            (COVERAGE_FACTOR * uncertainties[name] / limit for name, limit in self.until.items()),
            default=0.0,
        )


@dataclass(frozen=True)
class PlanCandidate:
    """A plan that determines what is asked.

    Attributes:
        words: its lines.
        plan: the plan.
        duration: of it.
        uncertainty: expanded (95 %) of the purpose's target, the worst of what counts, or of the
            only quantity that is wished, m or rad.
        determined: names of what counts and is determined.
        ratio: of the uncertainty to the wish, the largest of all; 0 without a wish.
        limited: what limits the uncertainty, in words; empty if not known.
        drift: expanded uncertainty beside it by drift at the machine's rate, the largest of what
            counts; NaN if not known.
    """

    words: str
    plan: Plan
    duration: PlanDuration
    uncertainty: float
    determined: tuple[str, ...]
    ratio: float = 0.0
    limited: str = ""
    drift: float = math.nan


def purpose_of(request: Request) -> PlanPurpose:
    """Return the purpose of a request.

    Raises:
        ValueError: there is no such purpose, or it needs a chain; or the stop has no uncertainty.
    """
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
    if not 0.0 < request.stop_uncertainty < 1.0:
        raise Refusal(
            f"the uncertainty of a stop is {request.stop_uncertainty:g} m; it must be positive",
            fault="out_of_range",
            aspect="uncertainty",
        )
    return purpose


def limits_of(purpose: str, text: str, source: str = "--until") -> dict[str, float]:
    """Return the wish that a text states: quantity → expanded uncertainty, m or rad.

    Args:
        purpose: a key of ``candidates.PURPOSES``.
        text: as of ``Target``; a size alone is of what counts for the purpose.
        source: what the user calls the text.

    Raises:
        ValueError: it cannot be read, or plans for the purpose have no such quantity.
    """
    known = PURPOSES[purpose]
    if "=" not in text:
        names = known.figures
        alike = "volumetric" if known.unit == "m" else "C0Y"
        size = Target.from_text(f"{alike}={text}", source=source).size
        return dict.fromkeys(names, size)
    target = Target.from_text(text, source=source)
    possible = known.needed if known.kinds else known.figures
    if target.line_and_parameter[0] or target.quantity not in possible:
        hint = " Use --for angular" if target.quantity in ROTATIONS else ""
        raise Refusal(
            f"{source}: a plan for {purpose} is not sought by the uncertainty of {target.words};"
            f" use one of {', '.join(possible)}, or a size alone.{hint}",
            fault="unknown",
            about=target.quantity,
        )
    return {target.quantity: target.size}
